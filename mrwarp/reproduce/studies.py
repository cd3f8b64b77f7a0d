"""Tables 2 and 3 and figure 5: the studies of section 6.2, made by ``mrwarp.study``."""

from __future__ import annotations

from mrwarp.reproduce import table5
from mrwarp.reproduce.experiment import Experiment, Findings, Job, NotYet


def compute(job: Job) -> Findings:
    """Rows of the study, once its policies are there."""
    table5.policies()
    raise NotYet("no policies yet: the study's evaluation is not there")


EXPERIMENTS = tuple(
    Experiment(name=name, title=title, compute=compute)
    for name, title in (
        ("table2", "Table 2: actuator-aware training"),
        ("table3", "Table 3: actuator models in training"),
        ("fig5", "Figure 5: learning curves"),
    )
)
