"""The joint in plain MuJoCo: :class:`Brake`."""

from mrwarp.mujoco.plain_brake import Brake

__all__ = ["Brake"]
