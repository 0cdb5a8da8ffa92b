"""Controllers: commands to winches from a model and from measurements. They may use statics, but not MuJoCo.

Each is a class with the two methods of ``core.controller.Controller``; ``cdpr_sim.track`` runs them.
"""

from cdpr_sim.control.elastic_lengths import ElasticLengths as ElasticLengths
from cdpr_sim.control.held_tensions import HeldTensions as HeldTensions
from cdpr_sim.control.lengths_and_tensions import LengthsAndTensions as LengthsAndTensions
from cdpr_sim.control.pose_feedback import PoseFeedback as PoseFeedback
from cdpr_sim.control.rigid_lengths import RigidLengths as RigidLengths
