"""Options of ``mrwarp asset show | set | check | diff | apply | export``."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from tyro.conf import Positional

from mrwarp.options import option_types as opt

NAME = opt.one(str, "PRIM")

Asset = Positional[Annotated[Path | None, opt.FILE]]


@dataclass(frozen=True, kw_only=True)
class Show:
    """Show joints, gains, MR numbers with unit, default and source, and masses."""

    file: Asset = None
    """USD file (default: the robot's own)"""
    robot: Annotated[str | None, opt.one(str, "ROBOT")] = None
    """variant: mr_go or go1 (default: mr_go where the file has it)"""
    payload: Annotated[str | None, opt.one(str, "KG")] = None
    """variant: 0 or 3 kg (default: 0 where the file has it)"""
    full: opt.Flag = False
    """list every number of every device"""


@dataclass(frozen=True, kw_only=True)
class Set:
    """Change one number; comments and layout of a text file stay."""

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


@dataclass(frozen=True, kw_only=True)
class CheckAsset:
    """Load every variant, check every number, convert it with Newton."""

    file: Asset = None
    """USD file (default: the robot's own)"""


@dataclass(frozen=True, kw_only=True)
class Diff:
    """Show numbers that differ; exit code 0 none, 1 some, 2 trouble."""

    a: Positional[Annotated[Path, opt.one(Path, "A")]]
    """USD file"""
    b: Positional[Annotated[Path, opt.one(Path, "B")]]
    """USD file"""


@dataclass(frozen=True, kw_only=True)
class Apply:
    """Write the numbers of a model.json onto the MR devices."""

    file: Positional[opt.File]
    """USD file"""
    model: Positional[Annotated[Path, opt.one(Path, "MODEL.json")]]
    """model.json, as 'mrwarp fit' writes it"""
    prim: Annotated[str, NAME] = "MRDevice"
    """joint or class; MRDevice is all four"""
    extrapolate: opt.Flag = False
    """let the coil take more current than the model was measured with"""
    out: opt.OptionalFile = None
    """write here and leave the file alone"""


@dataclass(frozen=True, kw_only=True)
class Export:
    """Write the numbers of an MR device as model.json."""

    file: Positional[opt.File]
    """USD file"""
    prim: Positional[Annotated[str | None, NAME]] = None
    """joint or class (default: the joints, if their numbers are the same)"""
    out: Annotated[Path, opt.one(Path, "MODEL.json")]
    """file to write"""
