"""A robot standing in its neutral stance, from the side."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from mrwarp.env.asset_trial import CONVERSION_DT
from mrwarp.env.sim_model import build_scene
from mrwarp.runtime import silent
from mrwarp.trials.fixed_base import has_rail, is_arm, on_the_ground
from mrwarp.usd.asset import RobotAsset
from mrwarp.viewing.robot_pictures import SideView


def draw(asset: RobotAsset, path: Path) -> None:
    """Draw the robot from its right side, as PNG; joints with a device carry a disc."""
    with silent():
        scene = build_scene(asset, dt=CONVERSION_DT, ground=has_rail(asset) or not is_arm(asset))
    qpos = on_the_ground(scene)
    height = scene.stand_height if scene.floating else 0.0
    if scene.floating:
        qpos[:7] = (0.0, 0.0, height, 1.0, 0.0, 0.0, 0.0)
    figure = Figure(figsize=(7, 5), layout="constrained")
    axis = figure.add_subplot()
    devices = sum(actuator.mr is not None for actuator in scene.actuators)
    SideView(scene).draw(axis, qpos, np.zeros(devices), np.zeros((len(scene.layout.legs), 3)))
    axis.autoscale_view()
    axis.set(aspect="equal", xlabel="x [m]", ylabel="z [m]", ylim=(-0.05 * height, None) if height else None)
    what = f"trunk {height:.3f} m high, " if height else ""
    axis.set_title(f"{asset.path.name}: {what}{devices} MR devices", fontsize=10)
    figure.savefig(path, dpi=110)
