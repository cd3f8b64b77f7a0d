"""Objects and functions of Python refuse values without sense: the message names value and remedy."""

from functools import partial
from math import inf, nan

import pytest

from benchmarks.perf.gpu import GpuCfg
from benchmarks.perf.timing import Spread
from mrwarp.bench.bench_effects import Effects
from mrwarp.energy.power import ElectricalCfg
from mrwarp.env import rewards
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RewardCfg, TerrainCfg
from mrwarp.env.config.sim_cfg import SimCfg, SolverCfg
from mrwarp.identify.monitor import MonitorCfg
from mrwarp.nn.models import make_net
from mrwarp.nn.training import FitCfg
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.trials.impact import ImpactCfg, Variant
from paper.reproduce.settings import Settings
from paper.study.plan import StudyCfg, plant_cfg
from paper.study.rollouts import EvaluationCfg
from tests.messages import has_parts

REFUSED: list[tuple[partial, str]] = [
    (partial(TaskCfg, actuator="magic"), "magic"),
    (partial(TaskCfg, actuator_file="net.safetensors"), "'bouc_wen' takes no actuator_file, got 'net.safetensors'"),
    (partial(TaskCfg, currents=()), "()"),
    (partial(TaskCfg, decimation=0), "0"),
    (partial(TaskCfg, gains=(0.0, 0.5)), "gains = (0.0, 0.5): Kp must be positive"),
    (partial(TaskCfg, coil_lag=-0.1), "coil_lag .. -0.1"),
    (partial(TaskCfg, hold_speed=0.0), "hold_speed .. 0"),
    (partial(TaskCfg, terrain="hilly"), "terrain = 'hilly' is unknown; choose from flat, rough"),
    (partial(TerrainCfg, levels=1), "levels = 1 must be at least 2"),
    (partial(TerrainCfg, cell=0.5), "cell = 0.5 m must be positive and at most a quarter"),
    (partial(TerrainCfg, tile=2.0), "tile = 2.0 m must be at least four times platform"),
    (partial(SimCfg, num_envs=0), "num_envs = 0 must be at least 1"),
    (partial(SimCfg, dt=0.0), "dt = 0.0 s must lie in (0, 0.02]"),
    (partial(SimCfg, dt=0.05), "dt = 0.05 s must lie in (0, 0.02]"),
    (partial(SolverCfg, ls_iterations=29), "ls_iterations = 29: below 30 .. use 30 or more"),
    (partial(RewardCfg, weights={"tilt": nan}), "reward tilt = nan must be finite"),
    (partial(rewards.check, RewardCfg(weights={"tlt": 1.0})), "reward 'tlt' is unknown; choose from track_v .. power"),
    (partial(PpoCfg, desired_kl=0.0), "desired_kl"),
    (partial(PpoCfg, desired_kl=inf), "desired_kl"),
    (partial(PpoCfg, entropy=-0.1), "entropy"),
    (partial(PpoCfg, entropy=nan), "entropy"),
    (partial(FitCfg, epochs=0), "epochs = 0"),
    (partial(make_net, "gru"), "no learned model 'gru'"),
    (partial(MonitorCfg, baseline=2), "at least 5"),
    (partial(Effects, {"coil_lagg": 0.1}), "did you mean 'coil_lag'"),
    *((partial(Effects, {"coil_lag": value}), "allowed: 0 to 1 s") for value in (-1.0, 2.0, nan)),
    (partial(ElectricalCfg, gear_efficiency=1.2), "gear_efficiency = .. allowed"),
    (partial(ElectricalCfg, regeneration=-0.1), "regeneration = .. allowed"),
    (partial(ElectricalCfg, electronics=nan), "electronics = .. allowed"),
    (partial(ImpactCfg, trials=0), "trials = 0 .. 1"),
    (partial(ImpactCfg, speed=nan), "must be finite"),
    (partial(ImpactCfg, force=(0.0, inf, 0.0)), "must be finite"),
    (partial(Settings, distance=0.0), "distance = 0.0 m"),
    *((partial(Settings, **{name: x}), f"{name} = {x} m") for name in ("distance", "window") for x in (nan, inf)),
    (partial(Settings, window=0.0), "window = 0.0 m"),
    (partial(plant_cfg, "spring"), "plant = 'spring': choose from conventional"),
    (partial(plant_cfg, "mlp", randomize="moon"), "randomize = 'moon' is unknown; choose from all, ground, none"),
    (partial(StudyCfg, power_price=nan), "power_price = nan 1/W must be finite and not negative"),
    (partial(EvaluationCfg, rollouts=0), "rollouts = 0 must be at least 1"),
    (partial(EvaluationCfg, seconds=0.0), "seconds = 0.0 must be positive"),
    (partial(EvaluationCfg, seeds=(0, 0)), "seeds = (0, 0): name each training seed once"),
    (partial(GpuCfg, rounds=1), "at least 2"),
    (partial(GpuCfg, parts=()), "walking, joint and"),
    *((partial(Spread.of, values), "finite") for values in ([], [1.0, nan], [inf])),
]
for bad in (-1.0, nan, inf):  # at any place of the list: the least of numbers and NaN is either
    for pair in ((0.5, bad), (bad, 0.5)):
        REFUSED.append((partial(TaskCfg, currents=pair), "finite .. 0 A"))
        REFUSED.append((partial(ImpactCfg, variants=tuple(Variant(current=x) for x in pair)), "finite .. 0"))


@pytest.mark.parametrize(("make", "said"), REFUSED, ids=[f"{p.func.__name__} {p.args}{p.keywords}" for p, _ in REFUSED])
def test_a_value_without_sense_is_refused(make: partial, said: str) -> None:
    """When the object is made, before anything is computed."""
    with pytest.raises(ValueError, match=r"\w") as refused:
        make()
    assert has_parts(str(refused.value), said), str(refused.value)
