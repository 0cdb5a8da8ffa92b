"""Controllers: commands for the winches, from a model and from sensors. They may use statics, and never MuJoCo.

Each is a class with the two methods of ``core.controller.Controller``; ``cdpr_sim.track`` runs them.
"""
