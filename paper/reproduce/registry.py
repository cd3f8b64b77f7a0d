"""All experiments: what each needs, and on which settings and files it depends."""

from __future__ import annotations

from collections.abc import Callable

from mrwarp.nn.models import SAMPLES
from paper.reproduce import (
    fig4,
    missions,
    predictions,
    support,
    training_results,
    walk_results,
    walks,
)
from paper.reproduce.cache import Experiment
from paper.reproduce.disturbance import drop_entries, drop_trials, push_entries, push_rule, table4
from paper.reproduce.motors import calf_torque, electrical
from paper.reproduce.settings import Settings, networks, study_files
from paper.study.plan import AWARE, BRAKE, CONVENTIONAL, MODELS, record_file
from paper.study.rollouts import PLANT

IMPACTS = ("impacted", "impacts", "seed")
WALKS = ("policies", "aware", "sticking", "high", "rollouts", "distance", "seed")
WINDOWS = ("policies", "rollouts", "window", "seed")
TRAININGS = (CONVENTIONAL, AWARE)


def _impacts(seconds: float) -> Callable[[Settings], float]:
    """Time of impacts [s], of which the report has 12 for each of five policies."""
    return lambda settings: seconds * (0.15 + 0.85 * len(settings.impacted) * settings.impacts / 60.0)


def _walks(seconds: float, length: str, usual: float) -> Callable[[Settings], float]:
    """Time of walks [s], of which the report has three for each of five policies; ``length`` is their setting."""
    return lambda settings: (
        seconds * (0.1 + 0.9 * settings.policy_seeds * settings.rollouts / 15.0 * getattr(settings, length) / usual)
    )


def _rollouts(settings: Settings) -> float:
    """Time of table 2 or 3 [s], which have three rollouts of each policy by either torque."""
    return 6.0 + 3.0 * settings.rollouts


_ALL = (
    Experiment(name="fig4", compute=fig4.compute, files=lambda: networks(SAMPLES), seconds=lambda _: 7.0),
    Experiment(name="fig5", compute=training_results.fig5, files=lambda: study_files(TRAININGS, record_file)),
    Experiment(
        name="table2",
        compute=training_results.table2,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(TRAININGS), *study_files(TRAININGS, folder=BRAKE), *networks((PLANT,))],
        seconds=_rollouts,
    ),
    Experiment(
        name="table3",
        compute=training_results.table3,
        settings=("rollouts", "seed"),
        files=lambda: [*study_files(MODELS), *study_files(MODELS, folder=BRAKE), *networks((PLANT,))],
        seconds=_rollouts,
    ),
    Experiment(
        name="pushes",
        compute=push_rule.simulate,
        settings=IMPACTS,
        files=lambda: networks((AWARE,)),
        seconds=_impacts(12.0),
    ),
    Experiment(
        name="drops",
        compute=drop_trials.simulate,
        settings=IMPACTS,
        files=lambda: [*study_files(TRAININGS), *study_files(TRAININGS, folder=BRAKE)],
        seconds=_impacts(16.0),
    ),
    Experiment(name="table4", compute=table4.compute, needs=("pushes", "drops")),
    Experiment(
        name="sensitivity",
        compute=push_entries.sensitivity,
        needs=("pushes",),
        settings=IMPACTS,
        seconds=_impacts(9.0),
    ),
    Experiment(name="fig6", compute=push_entries.fig6, needs=("pushes",)),
    Experiment(name="fig7", compute=drop_entries.fig7, needs=("drops",)),
    Experiment(name="table5", compute=drop_entries.table5, needs=("drops",)),
    Experiment(name="walks", compute=walks.simulate, settings=WALKS, seconds=_walks(260.0, "distance", 30.0)),
    Experiment(name="table6", compute=walk_results.table6, needs=("walks",)),
    Experiment(name="table7", compute=walk_results.table7, needs=("walks",)),
    Experiment(name="electrical", compute=electrical.compute, needs=("walks",)),
    Experiment(name="fig8", compute=calf_torque.fig8, needs=("walks",)),
    Experiment(name="fig9", compute=walk_results.fig9, needs=("walks",)),
    Experiment(
        name="support",
        compute=support.compute,
        needs=("walks",),
        settings=("policies", "window", "seed"),
        seconds=_walks(60.0, "window", 10.0),
    ),
    Experiment(name="windows", compute=missions.simulate, settings=WINDOWS, seconds=_walks(40.0, "window", 10.0)),
    Experiment(name="fig10", compute=missions.fig10, needs=("walks", "windows")),
    Experiment(name="fig11", compute=missions.fig11, needs=("walks", "windows")),
    Experiment(
        name="unseen",
        compute=predictions.simulate,
        settings=("policies", "impacted", "rollouts", "distance", "impacts", "seed"),
        seconds=_walks(120.0, "distance", 30.0),
    ),
    Experiment(
        name="predictions",
        compute=predictions.compute,
        needs=("unseen",),
        settings=("rollouts", "seed"),
        files=lambda: [*predictions.files(), *networks((PLANT,))],
        seconds=_rollouts,
    ),
)

CATALOGUE = {experiment.name: experiment for experiment in _ALL}
"""Experiments by name, each after what it needs; the entries of the report in the paper's order."""
