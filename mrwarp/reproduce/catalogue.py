"""All entries of the report in the paper's order."""

from __future__ import annotations

from mrwarp.reproduce import fig4, fig8, fig9, table6, table7, walking
from mrwarp.reproduce.experiment import Experiment

_ORDER = (fig4, walking, table6, table7, fig8, fig9)

CATALOGUE: dict[str, Experiment] = {module.EXPERIMENT.name: module.EXPERIMENT for module in _ORDER}
"""Experiments by name."""

SHOWN: tuple[str, ...] = tuple(name for name, experiment in CATALOGUE.items() if experiment.shown)
"""Names of the entries of the report; ``all`` means these."""
