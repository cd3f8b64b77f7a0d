"""All entries of the report in the paper's order."""

from __future__ import annotations

from mrwarp.reproduce import (
    drops,
    electrical,
    fig4,
    fig5,
    fig6,
    fig7,
    fig8,
    fig9,
    fig10,
    fig11,
    mission,
    pushes,
    sensitivity,
    table2,
    table3,
    table4,
    table5,
    table6,
    table7,
    walking,
)
from mrwarp.reproduce.experiment import Experiment

_ALL: tuple[Experiment, ...] = (
    *(module.EXPERIMENT for module in (fig4, fig5, table2, table3)),
    *(module.EXPERIMENT for module in (pushes, drops, table4, sensitivity, fig6, fig7, table5)),
    *(module.EXPERIMENT for module in (walking, table6, table7, electrical, fig8, fig9)),
    *(module.EXPERIMENT for module in (mission, fig10, fig11)),
)

CATALOGUE: dict[str, Experiment] = {experiment.name: experiment for experiment in _ALL}
"""Experiments by name."""

SHOWN: tuple[str, ...] = tuple(name for name, experiment in CATALOGUE.items() if experiment.shown)
"""Names of the entries of the report; ``all`` means these."""
