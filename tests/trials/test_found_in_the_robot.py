"""The whole way: an effect hidden on the bench is found in its recordings and put into the robot."""

from dataclasses import replace
from typing import Any

import pytest

from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.diagnose import diagnose
from mrwarp.model_file import make_effect
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.trials.impact_figures import impact_change

LAG = 0.1
"""Hidden coil lag [s]."""
STEP = 0.0005
"""Step of the bench's truth [s]: a command acts in the middle of one, and is logged at its edge."""
NOISE = {
    "torque_noise": 0.02, "coloured_noise": 0.01, "run_gain": 0.003, "run_bias": 0.003, "velocity_noise": 0.01,
    "encoder_step": 0.0003835,
}  # fmt: skip
CURRENT, TRIALS = 1.5, 30


@pytest.mark.slow
def test_lag_found_on_the_bench_changes_the_impact_as_the_true_one() -> None:
    """The lag is named to its interval; the robot then falls deeper and faster, as with the true lag."""
    effects = Effects({"coil_lag": LAG, **NOISE})
    cfg = BenchCfg(effects=effects, trajectories=12, samples=19200, evaluation_samples=0, seed=3)
    found = diagnose(run_bench(cfg).fit)
    assert [cause.name for cause in found.causes] == ["coil_lag"] and found.verdict == "named"
    lag = found.causes[0].parameters["time_constant"]
    assert lag.ci95 is not None
    known = 0.5 * (lag.ci95[1] - lag.ci95[0]) + 0.5 * STEP
    assert lag.value == pytest.approx(LAG, abs=known)
    assert found.model is not None

    plain = replace(found.model, effects=())
    true = replace(found.model, effects=(make_effect("coil_lag", {"time_constant": LAG}),))
    ours, theirs = (
        impact_change(plain, model, OnnxPolicy(DEFAULT_POLICY), currents=(CURRENT,), trials=TRIALS)
        for model in (found.model, true)
    )
    for name in ("min_height", "peak_speed", "damping_share"):
        want, got = figure(theirs, name), figure(ours, name)
        assert abs(got["change"] - want["change"]) < 0.5 * (want["ci95"][1] - want["ci95"][0]), name
    assert figure(ours, "min_height")["ci95"][1] < 0.0 < figure(ours, "peak_speed")["ci95"][0]


def figure(found: dict[str, Any], name: str) -> dict[str, Any]:
    """Change of a figure at the one current."""
    return found["rows"][0][name]
