"""Controllers: commands to winches from a model and from measurements. They may use statics, but not MuJoCo.

Those that plan with elastic cables do so for a robot whose cables have a memory, too: they know the stiffness of the
first loading, and what the memory changes is an error that feedback can reduce.

Each is a class with the two methods of ``core.controller.Controller``; ``cdpr_sim.track`` runs them.
"""
