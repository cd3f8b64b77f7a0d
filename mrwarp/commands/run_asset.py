"""Command line of the USD assets: ``mrwarp asset show | set | check | diff | apply | export``."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

from mujoco import MjModel
from pxr import Usd

from mrwarp.model_file import Model, ModelFileError, Parameter, load_model, save_model, silent_note
from mrwarp.options.arguments import Parser
from mrwarp.run_dir import one_line
from mrwarp.runtime import quiet_libraries, silent
from mrwarp.usd.asset import RobotAsset
from mrwarp.usd.edit import Change, edit_asset, find_prim
from mrwarp.usd.open_stage import ASSETS, AssetError
from mrwarp.usd.record import RECORD, PrimModel, is_mr, read_model, read_parameters, record_text, summary
from mrwarp.usd.scene_report import check_asset, diff_assets, load_variants, models, show_asset, value_text
from mrwarp.usd.stage_trial import open_stage

DEFAULT = ASSETS / "mr_go.usda"
_CONVERSION_DT = 0.005
"""Physics step of the trial conversion [s]; any positive number does."""


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp asset``."""
    parser = Parser(
        prog="mrwarp asset", description="Look at, edit, check and compare USD files of the robot or the bench."
    )
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")

    show = commands.add_parser("show", help="joints, gains, MR numbers with unit, default and source, and masses")
    show.add_argument("file", nargs="?", type=Path, default=DEFAULT, help="USD file (default: the robot's own)")
    show.add_argument("--robot", help="variant: mr_go or go1 (default: mr_go where the file has it)")
    show.add_argument("--payload", help="variant: 0 or 3 kg (default: 0 where the file has it)")
    show.add_argument("--full", action="store_true", help="list every number of every device")

    edit = commands.add_parser("set", help="change one number; comments and layout of a text file stay")
    edit.add_argument("file", type=Path, help="USD file")
    edit.add_argument("prim", help="joint such as FL_calf, class such as MRDevice (all four), or a prim path")
    edit.add_argument("attribute", help="such as K1 or newton:mr:K1; kp, kd or maxEffort of a plain motor")
    edit.add_argument("value", help="number in the attribute's unit, see 'mrwarp asset show'")
    edit.add_argument("--out", type=Path, metavar="F", help="write here and leave FILE alone")

    check = commands.add_parser("check", help="load every variant, check every number, convert it with Newton")
    check.add_argument("file", nargs="?", type=Path, default=DEFAULT, help="USD file (default: the robot's own)")

    diff = commands.add_parser("diff", help="numbers that differ; exit code 0 none, 1 some, 2 trouble")
    diff.add_argument("a", type=Path, help="USD file")
    diff.add_argument("b", type=Path, help="USD file")

    apply = commands.add_parser("apply", help="write the numbers of a model.json onto the MR devices")
    apply.add_argument("file", type=Path, help="USD file")
    apply.add_argument("model", type=Path, help="model.json, as 'mrwarp fit' writes it")
    apply.add_argument("--prim", default="MRDevice", help="joint or class (default: MRDevice, all four)")
    apply.add_argument("--out", type=Path, metavar="F", help="write here and leave FILE alone")

    export = commands.add_parser("export", help="write the numbers of an MR device as model.json")
    export.add_argument("file", type=Path, help="USD file")
    export.add_argument("prim", nargs="?", help="joint or class (default: the joints, if their numbers are the same)")
    export.add_argument("--out", type=Path, required=True, metavar="MODEL.json", help="file to write")
    return parser


def main(argv: list[str] | None = None) -> int:
    """Run a command; 0 done, 1 the files of ``diff`` differ, 2 bad input: then nothing was written."""
    args = make_parser().parse_args(argv)
    try:
        code = _COMMANDS[args.command](args)
        sys.stdout.flush()
        return code
    except BrokenPipeError:  # the reader, such as head, has seen enough
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 0
    except (AssetError, ModelFileError) as error:
        print(f"mrwarp asset {args.command}: {one_line(error)}", file=sys.stderr)
        return 2
    except OSError as error:
        print(f"mrwarp asset {args.command}: {one_line(error)}; name another file", file=sys.stderr)
        return 2


def _show(args: argparse.Namespace) -> int:
    asset = next(load_variants(args.file, args.robot, args.payload))
    for line in show_asset(asset, args.full):
        print(line)
    return 0


def _set(args: argparse.Namespace) -> int:
    return _edit(args, {args.attribute: args.value})


def _apply(args: argparse.Namespace) -> int:
    model = load_model(args.model)
    model.to_params()  # refuses other units than the simulator's
    code = _edit(args, model.values, lambda prim: record_text(model, read_parameters(prim, args.file)))
    if model.effects:
        for effect in model.effects:
            if effect.acts:
                print(f"acts in the simulator: {effect}")
        if note := silent_note(model.effects):
            print(note)
    return code


def _edit(
    args: argparse.Namespace, values: Mapping[str, float | str], record: Callable[[Usd.Prim], str] | None = None
) -> int:
    """Edit, and say what changed."""
    report = edit_asset(args.file, args.prim, dict(values), args.out, _checked, record)
    for change in report.changes:
        print(_change(change))
    for line in report.kept:
        print(line)
    if not report.changes:
        print(f"{args.prim} has these numbers already: {', '.join(values)}")
    if report.notice:
        print(f"mrwarp asset {args.command}: notice: {report.notice}", file=sys.stderr)
    print(f"wrote {report.path}")
    return 0


def _export(args: argparse.Namespace) -> int:
    if args.prim is None:
        asset = next(load_variants(args.file))
        params = {a.joint: a.mr for a in asset.actuators if a.mr is not None}
        held = models(asset)
        [first, *others] = held or [""]
        if not first or any((params[j], _content(held[j])) != (params[first], _content(held[first])) for j in others):
            text = "differ" if held else "are missing"
            raise AssetError(f"{args.file}: the joints' MR devices {text}; name one of: {', '.join(held) or 'none'}")
        found, source = held[first], f"{args.file}: {', '.join(held)}"
    else:
        stage = open_stage(args.file)
        prim = find_prim(stage, args.prim, args.file)
        if not is_mr(prim):
            raise AssetError(f"{args.file}: {prim.GetPath()} is a plain motor; name a joint with an MR device")
        found, source = read_model(prim, args.file), f"{args.file}: {prim.GetPath()}"
    model = found.model
    if found.applied is None:
        model = replace(model, fitted_on=replace(model.fitted_on, source=source))
    if found.changed:
        print(f"mrwarp asset export: notice: {found.note()}", file=sys.stderr)
    print(f"wrote {save_model(model, args.out)}")
    return 0


def _content(held: PrimModel) -> tuple[Mapping[str, Parameter], Model | None]:
    """What must be the same for two prims to be exported as one."""
    return held.model.parameters, held.applied


def _change(change: Change) -> str:
    if change.attribute == RECORD:
        return f"{change.prim} {RECORD}: {summary(change.before)} -> {summary(change.after)}"
    before = "none" if change.before is None else f"{change.before:.10g}"
    return f"{change.prim} {change.attribute}: {before} -> {value_text(change.attribute, change.after)}"


def convert(asset: RobotAsset) -> MjModel:
    """The MuJoCo model of an asset; Newton's notes are swallowed."""
    quiet_libraries()  # before the import below starts Warp
    from mrwarp.env.sim_model import build_scene

    with silent():
        return build_scene(asset, dt=_CONVERSION_DT, ground=asset.robot != "bench").model


def _checked(copy: Path) -> list[str]:
    return list(check_asset(copy, convert))


def _check(args: argparse.Namespace) -> int:
    for line in check_asset(args.file, convert):
        print(line, flush=True)
    return 0


def _diff(args: argparse.Namespace) -> int:
    lines = diff_assets(args.a, args.b)
    for line in lines:
        print(line)
    return 1 if lines else 0


_COMMANDS = {"show": _show, "set": _set, "check": _check, "diff": _diff, "apply": _apply, "export": _export}
