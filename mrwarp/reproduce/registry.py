"""All experiments: what each needs, and on which settings and files it depends."""

from __future__ import annotations

from mrwarp.nn.models import SAMPLES
from mrwarp.reproduce import (
    drops,
    electrical,
    fig4,
    impact_results,
    mission_results,
    missions,
    pushes,
    support,
    table4,
    table6,
    training_results,
    walks,
)
from mrwarp.reproduce.cache import Experiment
from mrwarp.reproduce.policies import networks, study_files
from mrwarp.study.plan import AWARE, CONVENTIONAL, MODELS, record_file
from mrwarp.study.rollouts import PLANT

IMPACTS = ("impacted", "aware", "impacts", "seed")
WALKS = ("policies", "aware", "sticking", "high", "rollouts", "distance", "seed")
WINDOWS = ("policies", "rollouts", "window", "seed")
TRAININGS = (CONVENTIONAL, AWARE)
READINGS = tuple(dict.fromkeys(reading.torque for reading in pushes.READINGS))

_ALL = (
    Experiment(name="fig4", compute=fig4.compute, files=lambda: networks(SAMPLES)),
    Experiment(name="fig5", compute=training_results.fig5, files=lambda: study_files(TRAININGS, record_file)),
    Experiment(
        name="table2",
        compute=training_results.table2,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(TRAININGS), *networks((PLANT,))],
    ),
    Experiment(
        name="table3",
        compute=training_results.table3,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(MODELS), *networks((PLANT,))],
    ),
    Experiment(name="pushes", compute=pushes.simulate, settings=IMPACTS, files=lambda: networks(READINGS)),
    Experiment(name="drops", compute=drops.simulate, settings=IMPACTS),
    Experiment(name="table4", compute=table4.compute, needs=("pushes", "drops")),
    Experiment(name="sensitivity", compute=impact_results.sensitivity, needs=("pushes",), settings=IMPACTS),
    Experiment(name="fig6", compute=impact_results.fig6, needs=("pushes",)),
    Experiment(name="fig7", compute=impact_results.fig7, needs=("drops",)),
    Experiment(
        name="table5",
        compute=impact_results.table5,
        settings=("impacts", "seed"),
        files=lambda: study_files(TRAININGS),
    ),
    Experiment(name="walks", compute=walks.simulate, settings=WALKS),
    Experiment(name="table6", compute=table6.compute, needs=("walks",)),
    Experiment(name="table7", compute=support.table7, needs=("walks",)),
    Experiment(name="electrical", compute=electrical.compute, needs=("walks",)),
    Experiment(name="fig8", compute=support.fig8, needs=("walks",)),
    Experiment(name="fig9", compute=table6.fig9, needs=("walks",)),
    Experiment(name="windows", compute=missions.simulate, settings=WINDOWS),
    Experiment(name="fig10", compute=mission_results.fig10, needs=("walks", "windows")),
    Experiment(name="fig11", compute=mission_results.fig11, needs=("walks", "windows")),
)

CATALOGUE = {experiment.name: experiment for experiment in _ALL}
"""Experiments by name, each after what it needs; the entries of the report in the paper's order."""
