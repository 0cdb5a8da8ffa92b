"""Environments of Gymnasium (extra ``gym``): learning and testing controllers on the dynamics of ``track``."""

ENVIRONMENTS = {"Track-v0": "Track", "Reach-v0": "Reach"}
"""Their ids, and their classes in ``environments``; with ``Vector`` appended, those that are vectorised."""


def register() -> None:
    """Register ``cdpr_sim/Track-v0`` and ``cdpr_sim/Reach-v0``; Gymnasium calls it when it is imported."""
    import gymnasium

    module = "cdpr_sim.learning.environments"
    for name, of in ENVIRONMENTS.items():
        if f"cdpr_sim/{name}" not in gymnasium.registry:
            gymnasium.register(
                f"cdpr_sim/{name}",
                entry_point=f"{module}:{of}",
                vector_entry_point=f"{module}:{of}Vector",
                order_enforce=False,  # the environments refuse a step before the first reset themselves
            )
