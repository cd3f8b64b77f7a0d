"""The report's entries in its order, a line each: the file that makes an entry, and its heading. Loads none of them."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Entry:
    """A table, a figure or a section of the paper."""

    module: str
    """File in this folder that makes its rows and pictures, ``EXPERIMENTS``, and has its claims, ``CLAIMS``."""
    title: str
    """Heading."""


CONTENTS = {
    "fig4": Entry("fig4", "Figure 4: torque prediction"),
    "fig5": Entry("table2", "Figure 5: learning curves"),
    "table2": Entry("table2", "Table 2: actuator-aware training"),
    "table3": Entry("table3", "Table 3: actuator models in training"),
    "table4": Entry("disturbance.table4", "Table 4: disturbance response"),
    "sensitivity": Entry("disturbance.push_entries", "Section 3.2: sensitivity to the gates' thresholds"),
    "fig6": Entry("disturbance.push_entries", "Figure 6: motor torque during the push"),
    "fig7": Entry("disturbance.fig7", "Figure 7: motor torque under the falling mass"),
    "table5": Entry("disturbance.table5", "Table 5: training and SAL under the falling mass"),
    "table6": Entry("table6", "Table 6: cost of transport"),
    "table7": Entry("table7", "Table 7: support activation"),
    "fig8": Entry("fig8", "Figure 8: stance support and torque relief"),
    "fig9": Entry("table6", "Figure 9: cost of transport"),
    "support": Entry("support", "Sections 3.3, 5.2 and 7: the support branch's free numbers, and the fastest speed"),
    "fig10": Entry("missions", "Figure 10: power and state of charge of the mission"),
    "fig11": Entry("missions", "Figure 11: temperatures of the mission"),
}
"""Entries by their names on the command line. A table is its file and a line here."""

SIMULATIONS = {
    "pushes": "disturbance.push_rule",
    "drops": "disturbance.drop_trials",
    "walks": "walks",
    "windows": "missions",
}
"""Files of the simulations that several entries read, by name."""

TITLES = {name: entry.title for name, entry in CONTENTS.items()}
"""Headings by name."""
