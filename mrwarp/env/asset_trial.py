"""A USD asset tried out: converted with Newton, and stood on its feet."""

from __future__ import annotations

import mujoco
import numpy as np

from mrwarp.env.sim_model import Scene, build_scene
from mrwarp.runtime import silent, unwarned
from mrwarp.usd.asset import RobotAsset
from mrwarp.usd.open_stage import AssetError
from mrwarp.usd.robot import FALL_HEIGHT, MR_GO, STAND_HEIGHT
from mrwarp.usd.scene_report import label

CONVERSION_DT = 0.005
"""Physics step of the trial conversion [s]; any positive number does."""

OUTSIDE_FEET = 0.3
"""How far outside the feet of one or two legs the weight may be, as a share of the trunk's height."""

LEVEL = 0.01
"""Largest difference of the soles' heights in the neutral stance [m]."""


def convert(asset: RobotAsset) -> mujoco.MjModel:
    """The MuJoCo model of an asset that can stand; Newton's notes and warnings are swallowed."""
    robot = asset.robot != "bench" and bool(asset.layout.legs)
    with silent(), unwarned("newton", "warp", "mrwarp.usd.converted"):
        scene = build_scene(asset, dt=CONVERSION_DT, ground=robot)
    if robot:
        check_stance(asset, scene)
    return scene.model


def check_stance(asset: RobotAsset, scene: Scene) -> None:
    """Refuse a robot that cannot stand in the neutral stance, which every trial begins with.

    Raises:
        AssetError: the feet are not level, not around the robot's weight, or too near to the trunk.
    """
    where, soles = f"{asset.path}: {label(asset)}: in the neutral stance", scene.soles
    own = asset.layout != MR_GO
    remedy = "correct the links' physics:localPos0 and localPos1"
    remedy = "correct mrwarp:neutral of the joints, or import it again with --pose or --feet" if own else remedy
    heights = ", ".join(f"{leg} {z:.3f}" for leg, z in zip(scene.layout.leg_names, soles[:, 2], strict=True))
    if np.ptp(soles[:, 2]) > LEVEL:
        raise AssetError(f"{where} the feet are not level: {heights} m from the trunk; allowed: {LEVEL} m; {remedy}")
    least = FALL_HEIGHT * (scene.stand_height / STAND_HEIGHT if own else 1.0)
    if scene.stand_height <= least:
        raise AssetError(
            f"{where} the trunk is {scene.stand_height:.3f} m high; needed: more than {least:.3g} m; {remedy}"
        )
    data = mujoco.MjData(scene.model)
    data.qpos[scene.q_adr] = scene.layout.default_q
    mujoco.mj_forward(scene.model, data)
    weight = data.subtree_com[0, :2] - data.qpos[:2]
    low, high = soles[:, :2].min(axis=0), soles[:, :2].max(axis=0)
    if len(soles) < 3:  # they span a line: the gait, not the stance, keeps it up
        low, high = low - OUTSIDE_FEET * scene.stand_height, high + OUTSIDE_FEET * scene.stand_height
    if not ((low < weight) & (weight < high)).all():
        spans = " and ".join(f"{a:.3f} to {b:.3f}" for a, b in zip(low, high, strict=True))
        at = f"{weight[0]:.3f}, {weight[1]:.3f}"
        raise AssetError(f"{where} the feet span {spans} m, the centre of mass is outside them at ({at}) m; {remedy}")
