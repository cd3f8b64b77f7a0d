"""All entries of the report in the paper's order."""

from __future__ import annotations

from dataclasses import replace

from mrwarp.reproduce import drops, electrical, pushes, sensitivity
from mrwarp.reproduce import missions as mission
from mrwarp.reproduce import walks as walking
from mrwarp.reproduce.experiment import Experiment
from mrwarp.reproduce.figures import fig4, fig5, fig6, fig7, fig8, fig9, fig10, fig11
from mrwarp.reproduce.tables import table2, table3, table4, table5, table6, table7
from mrwarp.reproduce.titles import TITLES

_ALL: tuple[Experiment, ...] = (
    *(module.EXPERIMENT for module in (fig4, fig5, table2, table3)),
    *(module.EXPERIMENT for module in (pushes, drops, table4, sensitivity, fig6, fig7, table5)),
    *(module.EXPERIMENT for module in (walking, table6, table7, electrical, fig8, fig9)),
    *(module.EXPERIMENT for module in (mission, fig10, fig11)),
)

CATALOGUE: dict[str, Experiment] = {
    experiment.name: replace(experiment, title=TITLES[experiment.name]) if experiment.shown else experiment
    for experiment in _ALL
}
"""Experiments by name."""
