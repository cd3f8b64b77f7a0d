"""Files of an extended robot while causes are written into them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from pxr import Usd

from mrwarp.robot_logs.replay_model import ReplayModel
from mrwarp.usd.asset import RobotAsset


@dataclass(frozen=True, kw_only=True)
class MjcfEdit:
    """A robot's MJCF."""

    spec: mujoco.MjSpec
    robot: ReplayModel

    def body(self, b: int) -> Any:
        """A body by its number."""
        name = self.robot.model.body(b).name
        return next(x for x in self.spec.bodies if x.name == name)

    def weighed(self, b: int) -> Any:
        """A body that states its mass and inertia as they were compiled."""
        mj, body = self.robot.model, self.body(b)
        if not body.explicitinertial:
            body.mass, body.ipos, body.iquat = mj.body_mass[b], mj.body_ipos[b], mj.body_iquat[b]
            body.inertia, body.fullinertia, body.explicitinertial = mj.body_inertia[b], [np.nan] * 6, True
        return body

    def add_to_joint(self, j: int, name: str, x: float) -> None:
        """Add to a number of the log's joint ``j``, such as its damping; it does not turn negative."""
        joint, mj, v = self.spec.joint(self.robot.joints[j]), self.robot.model, self.robot.v_adr[j]
        described = (
            getattr(mj, f"jnt_{name}")[mj.dof_jntid[v]] if name == "stiffness" else getattr(mj, f"dof_{name}")[v]
        )
        value = max(float(described) + x, 0.0)
        setattr(joint, name, [value, 0.0, 0.0] if np.ndim(getattr(joint, name)) else value)


@dataclass(frozen=True, kw_only=True)
class UsdEdit:
    """A robot's USD stage."""

    asset: RobotAsset
    robot: ReplayModel

    @property
    def stage(self) -> Usd.Stage:
        """The stage."""
        return self.asset.stage

    def body(self, b: int) -> Usd.Prim:
        """A body by its number."""
        return self.stage.GetPrimAtPath(self.stage.GetDefaultPrim().GetPath().AppendChild(self.robot.body_name(b)))

    def joint(self, j: int) -> Usd.Prim:
        """The log's joint ``j``."""
        root = self.stage.GetDefaultPrim().GetPath()
        return self.stage.GetPrimAtPath(root.AppendPath(f"joints/{self.robot.joints[j]}"))

    def drive(self, j: int) -> Usd.Prim:
        """Its drive."""
        name = self.robot.joints[j]
        return self.stage.GetPrimAtPath(next(a.prim_path for a in self.asset.actuators if a.joint == name))

    def scale_drive(self, j: int, names: Sequence[str], factor: float, most: float = np.inf) -> None:
        """Multiply numbers of a drive, of each no more than ``most``."""
        for attribute in self.drive(j).GetAttributes():
            if attribute.GetName().rpartition(":")[2] in names:
                attribute.Set(min(attribute.Get(), most) * factor)
