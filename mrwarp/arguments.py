"""Argument types that several commands share."""

from __future__ import annotations

import argparse
import math


def positive(text: str) -> float:
    """A positive, finite number."""
    value = float(text)
    if not (math.isfinite(value) and value > 0.0):
        raise argparse.ArgumentTypeError(f"{text} must be a positive number")
    return value


def not_negative(text: str) -> float:
    """A finite number of at least 0."""
    value = float(text)
    if not (math.isfinite(value) and value >= 0.0):
        raise argparse.ArgumentTypeError(f"{text} must be at least 0")
    return value
