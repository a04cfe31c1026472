"""AquaQuad Envs: reinforcement-learning environments for an air-water quadcopter.

Importing this package registers ``AquaQuad/DriftHop-v0`` with Gymnasium, and
``AquaQuad/SensorPlacement-v0``, a task of a team, with PettingZoo.
"""

from aquaquad_envs.interfaces.registration import register_all, sb3_vec_env
from aquaquad_envs.tasks.batch import make_world_batch

__version__ = "0.1.0"
__all__ = ["make_world_batch", "sb3_vec_env"]

register_all()
