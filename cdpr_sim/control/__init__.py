"""Controllers: commands to winches from a model and from measurements. They may use statics, but not MuJoCo.

Each is a class with the two methods of ``core.controller.Controller``; ``cdpr_sim.track`` runs them.
"""
