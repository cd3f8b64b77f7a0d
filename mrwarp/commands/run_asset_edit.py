"""``mrwarp asset set | check | apply``: change USD assets, and try every variant out with Newton."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from pathlib import Path

from mujoco import MjModel

from mrwarp.env.sim_model import build_scene
from mrwarp.model_file import HOLDING_NOTE, load_model, silent_note
from mrwarp.options.asset_options import Apply, CheckAsset, Set
from mrwarp.options.command_line import CommandLine
from mrwarp.runtime import silent
from mrwarp.usd.asset import RobotAsset
from mrwarp.usd.edit import Change, EditReport, edit_asset
from mrwarp.usd.open_stage import ASSETS
from mrwarp.usd.record import RECORD, summary
from mrwarp.usd.scene_report import check_asset, value_text

CONVERSION_DT = 0.005
"""Physics step of the trial conversion [s]; any positive number does."""


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


def convert(asset: RobotAsset) -> MjModel:
    """The MuJoCo model of an asset; Newton's notes are swallowed."""
    with silent():
        return build_scene(asset, dt=CONVERSION_DT, ground=asset.robot != "bench").model


def _checked(copy: Path) -> list[str]:
    return list(check_asset(copy, convert))
