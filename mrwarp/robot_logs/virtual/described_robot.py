"""Descriptions from which virtual robots are built: shipped ones, imported ones, and arms on a fixed base."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import mujoco
import numpy as np

from mrwarp.env.natural_units import Scales, scales
from mrwarp.env.sim_model import build_scene, shape_name
from mrwarp.params import MrParams
from mrwarp.robot_logs.replay_model import read_spec
from mrwarp.robot_logs.robot_log import LogError
from mrwarp.robot_logs.virtual.hidden_effects import Places
from mrwarp.run_dir import no_file, one_line
from mrwarp.runtime import silent
from mrwarp.usd.asset import ROBOT_SUFFIXES, load_robot
from mrwarp.usd.robot import Layout

STEP = 0.0005
"""Physics step [s]."""


@dataclass(frozen=True, kw_only=True)
class Device:
    """An MR device at a joint."""

    joint: int
    """Place on the joint axis."""
    leg: int
    params: MrParams


@dataclass(kw_only=True)
class Description:
    """Content of a robot's file."""

    path: Path
    spec: mujoco.MjSpec
    joints: tuple[str, ...]
    kp: np.ndarray
    """[N·m/rad], shape (J,)."""
    kd: np.ndarray
    """[N·m·s/rad], shape (J,)."""
    limit: np.ndarray
    """Largest torque [N·m], shape (J,)."""
    neutral: np.ndarray
    """Stance, or the pose about which a fixed robot moves [rad], shape (J,)."""
    trunk: str
    layout: Layout | None = None
    devices: tuple[Device, ...] = ()
    feet: tuple[str, ...] = ()
    """Shape of each leg's foot."""
    scales: Scales = field(default_factory=Scales)
    """Size of a robot on legs relative to the shipped one's."""

    @property
    def places(self) -> Places:
        """Places in which effects can be hidden."""
        legs = {leg.name: leg.joints for leg in self.layout.legs} if self.layout else {}
        bodies = tuple(b.name for b in self.spec.bodies if b.name not in ("world", self.trunk))
        devices = tuple(self.joints[d.joint] for d in self.devices)
        return Places(joint=self.joints, device=devices, body=bodies, trunk=self.trunk, legs=legs)


def describe(robot: str) -> Description:
    """Read a shipped robot, the USD file of an imported one, or an MJCF or URDF of a robot on a fixed base.

    Raises:
        LogError: it cannot be read, or has no driven joint.
    """
    path = Path(robot)
    if path.suffix in ROBOT_SUFFIXES or robot in ("mr_go", "go1"):
        return _described_usd(robot)
    if not path.is_file():
        raise LogError(
            f"{path}: {no_file(path, 'robot')}; name mr_go, go1, a .usda file of 'mrwarp robot import', "
            "or the MJCF or URDF of an arm"
        )
    try:
        with silent():
            spec = read_spec(path)
            model = spec.compile()
    except Exception as error:  # MuJoCo raises several types
        raise LogError(f"{path}: MuJoCo cannot read it ({one_line(error)}); correct it there") from None
    if any(joint.type == mujoco.mjtJoint.mjJNT_FREE for joint in spec.joints):
        raise LogError(f"{path}: its base floats; bring it in with 'mrwarp robot import' and name the .usda file")
    return _described_arm(path, spec, model)


def _described_usd(robot: str) -> Description:
    asset = load_robot(robot=robot)
    kept: list[mujoco.MjSpec] = []
    with silent():
        scene = build_scene(asset, dt=STEP, ground=False, edit=lambda spec: kept.append(spec.copy()))
    spec, layout = kept[0], asset.layout
    drives = asset.actuators
    root = next((b.name.removesuffix(layout.trunk) for b in spec.bodies if b.name.endswith(f"_{layout.trunk}")), "")
    for body in spec.bodies:  # Newton joins USD paths with underscores
        if body.name != "world":
            body.name = body.name.removeprefix(root)
    for exclude in list(spec.excludes):  # by the bodies' old names; only feet touch anything here
        spec.delete(exclude)
    for joint in spec.joints:
        joint.name = next((a.joint for a in drives if joint.name.endswith("_" + a.joint)), joint.name)
    feet = tuple(next(g.name for g in spec.geoms if shape_name(g.name) == leg.foot) for leg in layout.legs)
    floats = (j.parent.name for j in spec.joints if j.type == mujoco.mjtJoint.mjJNT_FREE)
    trunk = next(floats, None) or _bearer(spec.joint(drives[0].joint)).name
    legs = [next((k for k, leg in enumerate(layout.legs) if a.joint in leg.joints), 0) for a in drives]
    return Description(
        path=Path(robot),
        spec=spec,
        joints=tuple(a.joint for a in drives),
        kp=np.array([a.kp for a in drives]),
        kd=np.array([a.kd for a in drives]),
        limit=np.array([a.tau_limit for a in drives]),
        neutral=np.array([layout.neutral[a.joint] for a in drives]),
        trunk=trunk,
        feet=feet,
        layout=layout if feet else None,
        scales=scales(scene) if feet else Scales(),
        devices=tuple(Device(joint=j, leg=legs[j], params=a.mr) for j, a in enumerate(drives) if a.mr is not None),
    )


def _bearer(joint: mujoco.MjsJoint) -> mujoco.MjsBody:
    """The body before that of a joint."""
    return joint.parent.parent


def _described_arm(path: Path, spec: mujoco.MjSpec, model: mujoco.MjModel) -> Description:
    """An arm whose joints are driven by its position actuators, else with gains by the inertia that each moves."""
    hinge = [j for j in range(model.njnt) if model.jnt_type[j] == mujoco.mjtJoint.mjJNT_HINGE]
    if not hinge:
        raise LogError(f"{path}: there is no hinge that could be driven; name another robot")
    data = mujoco.MjData(model)
    if model.nkey:
        mujoco.mj_resetDataKeyframe(model, data, 0)
    mujoco.mj_forward(model, data)
    inertia = model.dof_M0
    kp, kd, limit, neutral = (np.zeros(len(hinge)) for _ in range(4))
    for k, j in enumerate(hinge):
        v, q = int(model.jnt_dofadr[j]), int(model.jnt_qposadr[j])
        own = [
            a
            for a in range(model.nu)
            if model.actuator_trntype[a] == mujoco.mjtTrn.mjTRN_JOINT and model.actuator_trnid[a, 0] == j
        ]
        kp[k] = 60.0 * inertia[v]  # without a gain: a drive of some 8 rad/s, well damped
        kd[k], limit[k] = 2.0 * np.sqrt(kp[k] * inertia[v]), 0.6 * kp[k] + np.abs(data.qfrc_bias[v]) * 2.0
        for a in own:
            if model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_AFFINE and model.actuator_gainprm[a, 0] > 0.0:
                kp[k], kd[k] = model.actuator_gainprm[a, 0], max(-model.actuator_biasprm[a, 2], 0.0)
                kd[k] = kd[k] or 2.0 * np.sqrt(kp[k] * inertia[v])
            if model.actuator_forcelimited[a]:
                limit[k] = abs(model.actuator_forcerange[a, 1])
            elif model.actuator_ctrllimited[a] and model.actuator_biastype[a] == mujoco.mjtBias.mjBIAS_NONE:
                limit[k] = abs(model.actuator_gainprm[a, 0] * model.actuator_ctrlrange[a, 1])
        if model.jnt_actfrclimited[j]:
            limit[k] = min(limit[k], abs(model.jnt_actfrcrange[j, 1]))
        low, high = model.jnt_range[j] if model.jnt_limited[j] else (-np.pi, np.pi)
        neutral[k] = float(np.clip(data.qpos[q], low + 0.2 * (high - low), high - 0.2 * (high - low)))
    return Description(
        path=path,
        spec=spec,
        joints=tuple(model.joint(j).name for j in hinge),
        kp=kp,
        kd=kd,
        limit=limit,
        neutral=neutral,
        trunk=model.body(int(model.body_parentid[model.jnt_bodyid[hinge[0]]])).name,
    )
