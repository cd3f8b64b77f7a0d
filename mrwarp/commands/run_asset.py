"""``mrwarp asset show | diff | export``: look at USD assets; loads no engine."""

from __future__ import annotations

import sys
from collections.abc import Mapping
from dataclasses import replace

from mrwarp.model_file import Model, Parameter, save_model
from mrwarp.options.asset_options import Diff, Export, Show
from mrwarp.options.command_line import CommandLine
from mrwarp.usd.edit import find_prim
from mrwarp.usd.open_stage import ASSETS, AssetError, open_stage
from mrwarp.usd.record import PrimModel, is_mr, read_model
from mrwarp.usd.scene_report import diff_assets, load_variants, models, show_asset


def run(options: Show | Diff | Export, line: CommandLine) -> int:
    """Run a command; 0 done, 1 the files of ``diff`` differ, 2 bad input: then nothing was written."""
    match options:
        case Show():
            lines = show_asset(
                next(load_variants(options.file or ASSETS / "mr_go.usda", options.robot, options.payload)), options.full
            )
        case Diff():
            lines = diff_assets(options.a, options.b)
        case Export():
            lines = [_export(options, line)]
    found = [*lines]
    for text in found:
        print(text)
    return int(isinstance(options, Diff) and bool(found))


def _export(options: Export, line: CommandLine) -> str:
    file = options.file
    if options.prim is None:
        asset = next(load_variants(file))
        params = {a.joint: a.mr for a in asset.actuators if a.mr is not None}
        held = models(asset)
        [first, *others] = held or [""]
        if not first or any((params[j], _content(held[j])) != (params[first], _content(held[first])) for j in others):
            text = "differ" if held else "are missing"
            raise AssetError(f"{file}: the joints' MR devices {text}; name one of: {', '.join(held) or 'none'}")
        found, source = held[first], f"{file}: {', '.join(held)}"
    else:
        stage = open_stage(file)  # kept: its prims live no longer
        prim = find_prim(stage, options.prim, file)
        if not is_mr(prim):
            raise AssetError(f"{file}: {prim.GetPath()} is a plain motor; name a joint with an MR device")
        found, source = read_model(prim, file), f"{file}: {prim.GetPath()}"
    model = found.model
    if found.applied is None:
        model = replace(model, fitted_on=replace(model.fitted_on, source=source))
    if found.changed:
        print(f"{line.prog}: notice: {found.note()}", file=sys.stderr)
    return f"wrote {save_model(model, options.out)}"


def _content(held: PrimModel) -> tuple[Mapping[str, Parameter], Model | None]:
    """What must be the same for two prims to be exported as one."""
    return held.model.parameters, held.applied
