"""Environments of Gymnasium (extra ``gym``): learning and testing controllers on the dynamics of ``track``.

Importing this package registers ``cdpr_sim/Track-v0`` and ``cdpr_sim/Reach-v0``. Gymnasium imports it by itself for ids
that name it, such as ``cdpr_sim.learning:cdpr_sim/Track-v0``.
"""

from cdpr_sim.core import extras

extras.require("gym", "cdpr_sim.learning")

import gymnasium  # noqa: E402

ENVIRONMENTS = {"Track-v0": "Track", "Reach-v0": "Reach"}
"""Their ids, and their classes in ``environments``; with ``Vector`` appended, those that are vectorised."""

for _name, _of in ENVIRONMENTS.items():
    gymnasium.register(
        f"cdpr_sim/{_name}",
        entry_point=f"cdpr_sim.learning.environments:{_of}",
        vector_entry_point=f"cdpr_sim.learning.environments:{_of}Vector",
        order_enforce=False,  # the environments refuse a step before the first reset themselves
    )
