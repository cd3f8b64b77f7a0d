"""The entries of the report and their headings in the paper's order; loads nothing, for ``--help``."""

from __future__ import annotations

TITLES = {
    "fig4": "Figure 4: torque prediction",
    "fig5": "Figure 5: learning curves",
    "table2": "Table 2: actuator-aware training",
    "table3": "Table 3: actuator models in training",
    "table4": "Table 4: disturbance response",
    "sensitivity": "Section 3.2: sensitivity to the gates' thresholds",
    "fig6": "Figure 6: motor torque during the push",
    "fig7": "Figure 7: motor torque under the falling mass",
    "table5": "Table 5: training and SAL under the falling mass",
    "table6": "Table 6: cost of transport",
    "table7": "Table 7: support activation",
    "electrical": "Sensitivity of table 6 to the electrical numbers",
    "fig8": "Figure 8: stance support and torque relief",
    "fig9": "Figure 9: cost of transport",
    "fig10": "Figure 10: power and state of charge of the mission",
    "fig11": "Figure 11: temperatures of the mission",
}
"""Heading of each entry, by its name on the command line; ``all`` means these."""
