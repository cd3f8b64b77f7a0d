"""``mrwarp asset set | check | apply``: change USD assets, and try every variant out with Newton."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

import mujoco
import numpy as np

from mrwarp.env.cfg import EnvCfg
from mrwarp.env.sim_model import Scene, build_scene
from mrwarp.model_file import HOLDING_NOTE, load_model, silent_note
from mrwarp.options.asset_options import Apply, CheckAsset, Set
from mrwarp.options.command_line import CommandLine
from mrwarp.runtime import silent
from mrwarp.usd.asset import RobotAsset
from mrwarp.usd.edit import Change, EditReport, edit_asset
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import RECORD, summary
from mrwarp.usd.robot import DEFAULT_Q, LEGS
from mrwarp.usd.scene_report import check_asset, label, value_text

CONVERSION_DT = 0.005
"""Physics step of the trial conversion [s]; any positive number does."""

LEVEL = 0.01
"""Largest difference of the soles' heights in the neutral stance [m]."""


def run(options: Set | Apply | CheckAsset, line: CommandLine) -> int:
    """Run a command; 0 done, 2 bad input: then nothing was written."""
    match options:
        case CheckAsset():
            for text in check_asset(options.file or ASSETS / "mr_go.usda", convert):
                print(text, flush=True)
        case Set():
            report = edit_asset(options.file, options.prim, {options.attribute: options.value}, options.out, _checked)
            _print(report, [options.attribute], options, line)
        case Apply():
            model = load_model(options.model)
            model.to_params()  # refuses other units than the simulator's
            report = edit_asset(
                options.file, options.prim, {}, options.out, _checked, model=model, extrapolate=options.extrapolate
            )
            _print(report, model.values, options, line)
            for effect in model.effects:
                if effect.acts:
                    print(f"acts in the simulator: {effect}")
            if note := silent_note(model.effects):
                print(note)
            if not model.holding_measured:
                print(HOLDING_NOTE)
    return 0


def _print(report: EditReport, names: Iterable[str], options: Set | Apply, line: CommandLine) -> None:
    """Say what an edit changed, or that it changed nothing."""
    for change in report.changes:
        print(_change(change))
    for text in report.kept:
        print(text)
    if not report.changes:
        print(f"{options.prim} has these numbers already: {', '.join(names)}")
    if report.notice:
        print(f"{line.prog}: notice: {report.notice}", file=sys.stderr)
    print(f"wrote {report.path}")


def _change(change: Change) -> str:
    if change.attribute == RECORD:
        return f"{change.prim} {RECORD}: {summary(change.before)} -> {summary(change.after)}"
    before = "none" if change.before is None else f"{change.before:.10g}"
    return f"{change.prim} {change.attribute}: {before} -> {value_text(change.attribute, change.after)}"


def convert(asset: RobotAsset) -> mujoco.MjModel:
    """The MuJoCo model of an asset that can stand; Newton's notes are swallowed."""
    robot = asset.robot != "bench"
    with silent():
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
    remedy = "correct the links' physics:localPos0 and localPos1"
    heights = ", ".join(f"{leg} {z:.3f}" for leg, z in zip(LEGS, soles[:, 2], strict=True))
    if np.ptp(soles[:, 2]) > LEVEL:
        raise AssetError(f"{where} the feet are not level: {heights} m from the trunk; allowed: {LEVEL} m; {remedy}")
    least = EnvCfg().fall_height
    if scene.stand_height <= least:
        raise AssetError(f"{where} the trunk is {scene.stand_height:.3f} m high; needed: more than {least} m; {remedy}")
    data = mujoco.MjData(scene.model)
    data.qpos[scene.q_adr] = DEFAULT_Q
    mujoco.mj_forward(scene.model, data)
    weight = data.subtree_com[0, :2] - data.qpos[:2]
    low, high = soles[:, :2].min(axis=0), soles[:, :2].max(axis=0)
    if not ((low < weight) & (weight < high)).all():
        spans = " and ".join(f"{a:.3f} to {b:.3f}" for a, b in zip(low, high, strict=True))
        at = f"{weight[0]:.3f}, {weight[1]:.3f}"
        raise AssetError(f"{where} the feet span {spans} m, the centre of mass is beside them at ({at}) m; {remedy}")


def _checked(copy: Path) -> list[str]:
    return list(check_asset(copy, convert))
