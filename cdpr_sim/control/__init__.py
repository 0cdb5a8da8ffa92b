"""Controllers: what winches are told, from a model and from sensors. They may use statics, and know no MuJoCo.

Each is a class of its own with the two methods of ``core.controller.Controller``; ``cdpr_sim.track`` runs them.
"""

from cdpr_sim.control.elastic_lengths import ElasticLengths as ElasticLengths
from cdpr_sim.control.held_tensions import HeldTensions as HeldTensions
from cdpr_sim.control.lengths_and_tensions import LengthsAndTensions as LengthsAndTensions
from cdpr_sim.control.pose_feedback import PoseFeedback as PoseFeedback
from cdpr_sim.control.rigid_lengths import RigidLengths as RigidLengths
