"""All entries of the report in the paper's order."""

from __future__ import annotations

from mrwarp.reproduce import (
    drops,
    electrical,
    fig4,
    fig6,
    fig7,
    fig8,
    fig9,
    fig10,
    fig11,
    mission,
    pushes,
    sensitivity,
    table4,
    table6,
    table7,
    walking,
)
from mrwarp.reproduce.experiment import Experiment

_ORDER = (
    fig4, pushes, drops, table4, sensitivity, fig6, fig7, walking, table6, table7, electrical, fig8, fig9, mission,
    fig10, fig11,
)  # fmt: skip

CATALOGUE: dict[str, Experiment] = {module.EXPERIMENT.name: module.EXPERIMENT for module in _ORDER}
"""Experiments by name."""

SHOWN: tuple[str, ...] = tuple(name for name, experiment in CATALOGUE.items() if experiment.shown)
"""Names of the entries of the report; ``all`` means these."""
