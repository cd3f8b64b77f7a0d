"""All experiments: what each needs, and on which settings and files it depends."""

from __future__ import annotations

from mrwarp.nn.models import SAMPLES
from mrwarp.reproduce import drops, electrical, missions, pushes, sensitivity, walks
from mrwarp.reproduce.experiment import Experiment
from mrwarp.reproduce.figures import fig4, fig5, fig6, fig7, fig8, fig9, fig10, fig11
from mrwarp.reproduce.policies import networks, study_files
from mrwarp.reproduce.tables import table2, table3, table4, table5, table6, table7
from mrwarp.study.plan import AWARE, CONVENTIONAL, MODELS, record_file
from mrwarp.study.rollouts import PLANT

IMPACTS = ("impacted", "aware", "impacts", "seed")
WALKS = ("policies", "aware", "sticking", "high", "rollouts", "distance", "seed")
TRAININGS = (CONVENTIONAL, AWARE)

_ALL = (
    Experiment(name="fig4", compute=fig4.compute, files=lambda: networks(SAMPLES)),
    Experiment(name="fig5", compute=fig5.compute, files=lambda: study_files(TRAININGS, record_file)),
    Experiment(
        name="table2",
        compute=table2.compute,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(TRAININGS), *networks((PLANT,))],
    ),
    Experiment(
        name="table3",
        compute=table3.compute,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(MODELS), *networks((PLANT,))],
    ),
    Experiment(
        name="pushes",
        compute=pushes.simulate,
        settings=IMPACTS,
        files=lambda: networks(dict.fromkeys(reading.torque for reading in pushes.READINGS)),
    ),
    Experiment(name="drops", compute=drops.simulate, settings=IMPACTS),
    Experiment(name="table4", compute=table4.compute, needs=("pushes", "drops")),
    Experiment(name="sensitivity", compute=sensitivity.compute, needs=("pushes",), settings=IMPACTS),
    Experiment(name="fig6", compute=fig6.compute, needs=("pushes",)),
    Experiment(name="fig7", compute=fig7.compute, needs=("drops",)),
    Experiment(
        name="table5",
        compute=table5.compute,
        settings=("impacts", "seed"),
        files=lambda: study_files(TRAININGS),
    ),
    Experiment(name="walks", compute=walks.simulate, settings=WALKS),
    Experiment(name="table6", compute=table6.compute, needs=("walks",)),
    Experiment(name="table7", compute=table7.compute, needs=("walks",)),
    Experiment(name="electrical", compute=electrical.compute, needs=("walks",)),
    Experiment(name="fig8", compute=fig8.compute, needs=("walks",)),
    Experiment(name="fig9", compute=fig9.compute, needs=("walks",)),
    Experiment(name="windows", compute=missions.simulate, settings=("policies", "rollouts", "window", "seed")),
    Experiment(name="fig10", compute=fig10.compute, needs=("walks", "windows")),
    Experiment(name="fig11", compute=fig11.compute, needs=("walks", "windows")),
)

CATALOGUE = {experiment.name: experiment for experiment in _ALL}
"""Experiments by name, each after what it needs; the entries of the report in the paper's order."""
