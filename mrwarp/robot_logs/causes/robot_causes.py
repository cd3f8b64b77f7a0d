"""The catalogue of a robot's causes: one declaration each, in these files. Adding one = its file and its line."""

from __future__ import annotations

import importlib

from mrwarp.robot_logs.causes.cause import NUISANCE, Cause

FILES = (
    "of_joints",
    "of_drives",
    "of_devices",
    "of_timing",
    "of_channels",
    "of_hidden",
    "of_links",
    "of_ground",
    "of_outside",
)
"""Files of causes in this folder, each with its ``CAUSES``."""

DECLARED: tuple[Cause, ...] = tuple(
    cause for name in FILES for cause in importlib.import_module(f"mrwarp.robot_logs.causes.{name}").CAUSES
)
"""All causes and nuisances."""

CATALOGUE: dict[str, Cause] = {cause.name: cause for cause in DECLARED if cause.name != NUISANCE}
"""Causes by name."""

NUISANCES: dict[str, Cause] = {cause.field: cause for cause in DECLARED if cause.name == NUISANCE}
"""Numbers that a healthy robot has and that are never a cause, by field."""

ORDINARY = tuple(name for name, cause in CATALOGUE.items() if cause.ordinary)
"""Numbers that descriptions rarely know: fitted in every case, and named where the log excludes the description."""

SETUP = tuple(name for name, cause in CATALOGUE.items() if cause.setup)
"""How a robot's drives are set up, which is no fault: acts in each replay, and is said in a note."""

READS = tuple((cause, cause.reads) for cause in CATALOGUE.values() if cause.reads is not None)
"""Causes that act on readings of the torque channel alone."""

OUTSIDE = tuple(name for name, cause in CATALOGUE.items() if cause.outside)
"""Effects that are tried, and reported as unexplained."""

DRIVE = tuple(name for name, cause in CATALOGUE.items() if cause.made_of or any(name in x.made_of for x in DECLARED))
"""A drive's torque is a line in Kp and Kd: a factor on all of it is both, so no more than two of the three are
named."""


ACTING = tuple((cause, cause.acts) for cause in DECLARED if cause.acts is not None)
"""Causes that say themselves what they do to a replayed robot."""


def declared(cause: str, field: str) -> Cause:
    """The declaration of a cause, or of the nuisance with that field."""
    return NUISANCES[field] if cause == NUISANCE else CATALOGUE[cause]
