"""The MR joint in mjlab (1.6): an actuator for its robots, the startup event that its brakes need, and tasks of a Go1.

mjlab pins another MuJoCo, so it has an environment of its own; the core of mrwarp is enough there. See
``docs/integrations.md``.
"""

# first: at its end it imports the packages of its entry points, which are these tasks, and they need what follows here
import mjlab  # noqa: F401

from mrwarp.integrations.mjlab.joint_actuator import MrJointActuator, MrJointActuatorCfg, brakes

__all__ = ["MrJointActuator", "MrJointActuatorCfg", "brakes"]
