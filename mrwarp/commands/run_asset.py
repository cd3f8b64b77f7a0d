"""``mrwarp asset``: show, change, check and compare USD assets; only ``check`` loads an engine."""

from __future__ import annotations

import sys
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from tyro.conf import Positional

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.runtime import four_digits

if TYPE_CHECKING:
    from mrwarp.model_file import Model

NAME = opt.one(str, "PRIM")
Asset = Positional[Annotated[Path | None, opt.FILE]]


@dataclass(frozen=True, kw_only=True)
class Show(Options):
    """Show joints, gains, MR numbers with unit, default and source, and masses."""

    engines = False
    file: Asset = None
    """USD file (default: the robot's own)"""
    robot: Annotated[str | None, opt.one(str, "ROBOT")] = None
    """variant: mr_go or go1 (default: mr_go where the file has it)"""
    payload: Annotated[str | None, opt.one(str, "KG")] = None
    """variant: 0 or 3 kg (default: 0 where the file has it)"""
    full: opt.Flag = False
    """list every number of every device"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input."""
        from mrwarp.usd.open_stage import ASSETS
        from mrwarp.usd.scene_report import load_variants, show_asset

        asset = next(load_variants(self.file or ASSETS / "mr_go.usda", self.robot, self.payload))
        print("\n".join(show_asset(asset, self.full)))
        return 0


@dataclass(frozen=True, kw_only=True)
class Diff(Options):
    """Show numbers that differ; exit code 0 none, 1 some, 2 trouble."""

    engines = False
    a: Positional[Annotated[Path, opt.one(Path, "A")]]
    """USD file"""
    b: Positional[Annotated[Path, opt.one(Path, "B")]]
    """USD file"""

    def run(self, line: CommandLine) -> int:
        """0 nothing differs, 1 something does, 2 on bad input."""
        from mrwarp.usd.scene_report import diff_assets

        found = diff_assets(self.a, self.b)
        for text in found:
            print(text)
        return int(bool(found))


@dataclass(frozen=True, kw_only=True)
class CheckAsset(Options):
    """Load every variant, check every number, convert it with Newton."""

    file: Asset = None
    """USD file (default: the robot's own)"""

    def run(self, line: CommandLine) -> int:
        """0 when every variant works, 2 when one does not."""
        from mrwarp.env.asset_trial import convert
        from mrwarp.usd.open_stage import ASSETS
        from mrwarp.usd.scene_report import check_asset

        for text in check_asset(self.file or ASSETS / "mr_go.usda", convert):
            print(text, flush=True)
        return 0


@dataclass(frozen=True, kw_only=True)
class Set(Options):
    """Change one number; comments and layout of a text file stay."""

    engines = False
    file: Positional[opt.File]
    """USD file"""
    prim: Positional[Annotated[str, NAME]]
    """joint such as FL_calf, class such as MRDevice (all four), or a prim path"""
    attribute: Positional[Annotated[str, opt.one(str, "ATTRIBUTE")]]
    """such as K1 or newton:mr:K1; kp, kd or maxEffort of a plain motor"""
    value: Positional[Annotated[str, opt.one(str, "VALUE")]]
    """number in the attribute's unit, see 'mrwarp asset show'"""
    out: opt.OptionalFile = None
    """write here and leave the file alone"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input: then nothing was written."""
        _edit(self, line, {self.attribute: self.value}, None)
        return 0


@dataclass(frozen=True, kw_only=True)
class Apply(Options):
    """Write the numbers of a model.json onto the MR devices."""

    engines = False
    file: Positional[opt.File]
    """USD file"""
    model: Positional[Annotated[Path, opt.one(Path, "MODEL.json")]]
    """model.json, as 'mrwarp fit' writes it, or a device of 'mrwarp device list'"""
    prim: Annotated[str, NAME] = "MRDevice"
    """joint or class; MRDevice is all four"""
    extrapolate: opt.Flag = False
    """let the coil take more current than the model was measured with"""
    out: opt.OptionalFile = None
    """write here and leave the file alone"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input: then nothing was written."""
        from mrwarp.model_file import HOLDING_NOTE, load_model, silent_note

        model = load_model(self.model)
        model.to_params()  # refuses other units than the simulator's
        _edit(self, line, {}, model, extrapolate=self.extrapolate)
        for effect in model.effects:
            if effect.acts:
                print(four_digits(f"acts in the simulator: {effect}"))
        if note := silent_note(model.effects):
            print(note)
        if not model.holding_measured:
            print(HOLDING_NOTE)
        return 0


@dataclass(frozen=True, kw_only=True)
class Export(Options):
    """Write the numbers of an MR device as model.json."""

    engines = False
    file: Positional[opt.File]
    """USD file"""
    prim: Positional[Annotated[str | None, NAME]] = None
    """joint or class (default: the joints, if their numbers are the same)"""
    out: Annotated[Path, opt.one(Path, "MODEL.json")]
    """file to write"""

    def run(self, line: CommandLine) -> int:
        """0 done, 2 on bad input: then nothing was written."""
        from mrwarp.model_file import save_model
        from mrwarp.usd.edit import find_prim
        from mrwarp.usd.open_stage import AssetError, open_stage
        from mrwarp.usd.record import is_mr, read_model
        from mrwarp.usd.scene_report import load_variants, models

        if self.prim is None:
            asset = next(load_variants(self.file))
            params = {a.joint: a.mr for a in asset.actuators if a.mr is not None}
            held = models(asset)
            contents = [(params[joint], own.model.parameters, own.applied) for joint, own in held.items()]
            if not contents or any(content != contents[0] for content in contents):
                text = "differ" if held else "are missing"
                raise AssetError(
                    f"{self.file}: the joints' MR devices {text}; name one of: {', '.join(held) or 'none'}"
                )
            found, source = next(iter(held.values())), f"{self.file}: {', '.join(held)}"
        else:
            stage = open_stage(self.file)  # kept: its prims live no longer
            prim = find_prim(stage, self.prim, self.file)
            if not is_mr(prim):
                raise AssetError(f"{self.file}: {prim.GetPath()} is a plain motor; name a joint with an MR device")
            found, source = read_model(prim, self.file), f"{self.file}: {prim.GetPath()}"
        model = found.model
        if found.applied is None:
            model = replace(model, fitted_on=replace(model.fitted_on, source=source))
        if found.changed:
            print(f"{line.prog}: notice: {found.note()}", file=sys.stderr)
        print(f"wrote {save_model(model, self.out)}")
        return 0


def _edit(
    options: Set | Apply, line: CommandLine, values: dict[str, Any], model: Model | None, *, extrapolate: bool = False
) -> None:
    from mrwarp.usd.edit import changes_by_prim, edit_asset
    from mrwarp.usd.scene_report import load_variants, masses, models

    def check(copy: Path) -> None:
        """Load every variant; numbers of actuators are no business of the conversion, which takes seconds."""
        for asset in load_variants(copy):
            masses(asset)
            models(asset)

    report = edit_asset(options.file, options.prim, values, options.out, check, model=model, extrapolate=extrapolate)
    for text in (*changes_by_prim(report.changes), *report.kept):
        print(text)
    if not report.changes:
        print(f"{options.prim} has these numbers already: {', '.join(model.values if model else values)}")
    if report.notice:
        print(f"{line.prog}: notice: {report.notice}", file=sys.stderr)
    print(f"wrote {report.path}")
