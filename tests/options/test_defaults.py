"""Defaults of the options, which load no engine, are those of the configurations that they become."""

from pathlib import Path

from mrwarp.bench.virtual_bench import BenchCfg
from mrwarp.commands.run_bench import Bench
from mrwarp.commands.run_fit import Learn
from mrwarp.enums import LEARNED
from mrwarp.nn.models import SAMPLES
from mrwarp.nn.training import FitCfg
from mrwarp.options.option_types import CURRENTS
from mrwarp.usd.robot import CURRENT_GROUPS
from paper.commands.run_reproduce import Reproduce, TrainFigure4
from paper.commands.run_study import StudyTrain
from paper.reproduce.settings import Settings
from paper.study import plan
from paper.study.plan import StudyCfg


def test_study() -> None:
    """Trainings of the studies."""
    options, cfg = StudyTrain(), StudyCfg()
    for name in ("num_envs", "iterations", "terrain", "randomize", "power_price", "seeds", "plants", "start_from"):
        assert getattr(options, name) == getattr(cfg, name), name
    assert plan.STUDY.name == "study"


def test_currents() -> None:
    """Groups of robots."""
    assert CURRENTS == CURRENT_GROUPS


def test_bench_and_learned_models() -> None:
    """Sessions on the bench, and the recipe of networks."""
    bench, session = Bench(), BenchCfg()
    for name in ("trajectories", "samples", "evaluation_samples", "policy", "seed"):
        assert getattr(bench, name) == getattr(session, name), name
    learn, recipe = Learn(data=Path("data"), out=Path("out")), FitCfg()
    for name in ("epochs", "windows_per_epoch", "patience", "seed"):
        assert getattr(learn, name) == getattr(recipe, name), name
    assert set(LEARNED) == set(SAMPLES)


def test_reproduction() -> None:
    """The report, and the training of figure 4's models."""
    options, settings = Reproduce(part=("all",)), Settings()
    for name in ("rollouts", "impacts", "distance", "window", "seed", "threads"):
        assert getattr(options, name) == getattr(settings, name), name
    training, recipe, session = TrainFigure4(out=Path("out")), FitCfg(), BenchCfg()
    assert training.windows_per_epoch == recipe.windows_per_epoch
    assert (training.samples, training.trajectories) == (session.samples, session.trajectories)
