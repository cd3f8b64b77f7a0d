"""Walking trials: the meter agrees with the ledger, conditions are what they say, short walks, loads, commands."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mrwarp import paper
from mrwarp.energy import model_numbers
from mrwarp.energy.power import ElectricalCfg
from mrwarp.env.cfg import TaskCfg
from mrwarp.kernels import ledger
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.trials import walk_figures
from mrwarp.trials.power_meter import PowerMeter
from mrwarp.trials.walk_trials import WalkBatch, WalkCfg, WalkResult, robot_env, standing_load, walk
from mrwarp.trials.walking import make_env, set_payload
from tests.messages import Refused

ENV = TaskCfg(threads=1)
SHORT = WalkCfg(payloads=(0.0,), speeds=(0.5,), trials=2, distance=0.6, warmup=0.6, env=ENV)


@pytest.fixture(scope="module")
def policies() -> dict[str, OnnxPolicy]:
    """The shipped policy, opened for each robot: each is then asked with the same number of rows in any company.

    A matrix product rounds by its number of rows, and contacts amplify one rounding to 1e-6 within a second.
    """
    return {robot: OnnxPolicy(DEFAULT_POLICY) for robot in paper.ROBOTS}


@pytest.fixture(scope="module")
def results(policies: dict[str, OnnxPolicy]) -> list[WalkResult]:
    """A short walk of all three robots."""
    return walk(SHORT, policies)


def test_a_model_goes_to_the_robots_that_carry_a_device() -> None:
    """`mrwarp walk --model` compares with Go1, which has none."""
    env = replace(ENV, model="model.json")
    assert [robot_env(env, robot, 3).model for robot in paper.ROBOTS] == [None, "model.json", "model.json"]


def test_meter_agrees_with_the_ledger() -> None:
    """Net work, squared torque and coil loss are the energy ledger's, speed the joints'; only what is on counts."""
    env = make_env(replace(ENV, currents=(1.5,)), 3, 0)
    meter = PowerMeter(env)
    before = env.view(env.actuator.ledger).clone()
    meter.on[:2] = True
    turned = torch.zeros(3, 12)
    env.substep_hooks.append(lambda: turned.add_(env.qd.abs()))
    generator = torch.Generator().manual_seed(0)
    for _ in range(10):
        env.step(0.5 * torch.randn(3, 12, generator=generator))
    gained = (env.view(env.actuator.ledger) - before)[:2].numpy()
    joints, seconds = meter.joint_load(), 10 * env.cfg.step_dt
    # float32 sums of 40 steps: half a rounding of the sum a step, and a few of each term; work of both signs cancels
    rounding = 40 * float(np.finfo(np.float32).eps)
    np.testing.assert_allclose(
        (joints.work_out - joints.work_in)[:2] * seconds,
        gained[:, :, int(ledger.MOTOR)],
        rtol=0,
        atol=rounding * float((joints.work_out + joints.work_in)[:2].max()) * seconds,
    )
    square, coil = gained[:, :, int(ledger.MOTOR_SQUARE)], gained[:, 2::3, int(ledger.COIL)]
    np.testing.assert_allclose(joints.torque_square[:2] * seconds, square, rtol=rounding)
    np.testing.assert_allclose(joints.coil[:2] * seconds, coil, rtol=rounding)
    assert joints.friction.min() >= 0.0
    np.testing.assert_allclose(meter.seconds, [seconds, seconds, 0.0])
    assert meter.counts[:2].sum(-1).eq(40).all() and not meter.counts[2].any()
    np.testing.assert_allclose(joints.speed[:2], turned[:2].numpy() / 40, rtol=rounding)
    assert joints.speed[:2].min() > 0.0 and not joints.torque_square[2].any() and not joints.speed[2].any()


def test_robots_are_what_they_say(results: list[WalkResult]) -> None:
    """Masses of section 6.4; Go1 has no devices; SAL off never holds and feeds no coil; SAL on does both."""
    by_robot = {result.robot: result for result in results}
    assert [by_robot[robot].mass for robot in paper.ROBOTS] == pytest.approx([12.0, 12.6, 12.6], abs=1e-5)
    assert by_robot["go1"].joints.coil.shape == (2, 0)
    off, on = by_robot["mr_go"], by_robot["mr_go_sal"]
    assert not off.hold.any() and not off.joints.coil.any() and off.joints.friction.min() > 0.0
    assert on.hold.mean() > 0.1 and on.joints.coil.mean() > 0.0
    assert on.joints.torque_square[:, 2::3].mean() < 0.8 * off.joints.torque_square[:, 2::3].mean()


def test_every_trial_covers_the_distance(results: list[WalkResult]) -> None:
    """Speed times time is the distance, to within one policy step."""
    for result in results:
        assert result.fell == 0 and result.late == 0
        covered = result.speed * result.seconds
        assert np.all(covered >= SHORT.distance) and np.all(covered < SHORT.distance + 0.03)
        assert result.counts.sum() == pytest.approx(3 * 200.0 * result.seconds.sum(), rel=1e-6)
        assert np.all(result.motion["height_rmse"] >= result.motion["height_sd"] - 1e-9)


def test_a_condition_in_a_batch_equals_the_same_alone(
    results: list[WalkResult], policies: dict[str, OnnxPolicy]
) -> None:
    """MR_Go-SAL next to MR_Go and by itself: the same bits."""
    alone = WalkBatch(SHORT, ("mr_go_sal",), 0.0, policies).run()[0]
    batched = next(result for result in results if result.robot == "mr_go_sal")
    np.testing.assert_array_equal(alone.joints.torque_square, batched.joints.torque_square)
    np.testing.assert_array_equal(alone.hold, batched.hold)


def test_rows_say_what_was_calibrated(results: list[WalkResult]) -> None:
    """Go1's row of table 6 was used to calibrate, those of the MR robots were not; the parts add up to the power."""
    for result in results:
        row = walk_figures.row(result, ElectricalCfg())
        assert row["calibrated"] == (result.robot == "go1")
        assert not walk_figures.row(result, ElectricalCfg(), calibrated=False)["calibrated"]
        assert sum(row["parts"].values()) == pytest.approx(row["power"]["mean"])
        assert row["paper"]["cot"] == paper.TABLE_6[result.robot, 0, 0.5].cot
    saved = walk_figures.savings(results, ElectricalCfg(), 20.0)
    assert len(saved) == 1 and not saved[0].calibrated
    assert sum(saved[0].saving_by_part.values()) == pytest.approx(saved[0].saving)


def test_another_device_has_no_paper_row_beside_it(results: list[WalkResult]) -> None:
    """Go1 carries no device and keeps its row; of MR_Go and MR_Go-SAL nothing is compared, nor of what SAL saves."""
    assert all(result.paper_device for result in results)
    others = [replace(result, paper_device=result.robot == "go1") for result in results]
    for result in others:
        row = walk_figures.row(result, ElectricalCfg())
        compared = [row[name] is not None for name in ("paper", "difference")]
        assert compared == [result.robot == "go1"] * 2 and row["paper_hold_mean"] is None
    (saved,) = walk_figures.savings(others, ElectricalCfg(), 20.0)
    assert saved.paper is None and set(saved.bound) == {"walking_copper", "our_standing"}


def test_traces_hold_two_strides(results: list[WalkResult]) -> None:
    """The front-right calf at 200 Hz while the walk lasts, at most two strides; Go1 has no device to show."""
    for result in results:
        assert 0 < len(result.trace.t) <= round(2 / 1.5 * 200)
        assert result.trace.values["tau_mr"].any() == (result.robot != "go1")


def test_loads_between_the_variants() -> None:
    """1.5 kg on the back add 1.5 kg; a load needs the variant that has the body."""
    env = make_env(replace(ENV, payload=3), 2, 0)
    set_payload(env, np.array([1.5, 0.0]))
    mass = env.sim.backend.expand("body_mass").numpy().sum(axis=1)
    assert mass == pytest.approx([14.1, 12.601], abs=1e-4)
    with pytest.raises(ValueError, match="payload variant"):
        set_payload(make_env(ENV, 1, 0), np.array([1.0]))


def test_standing_on_the_devices_spares_the_calf_motors() -> None:
    """The knee carries a quarter of the weight at 0.213 sin(0.7) m: about 4 N·m; held, kp_low leaves a 21st of it."""
    cfg = replace(ENV, payload=3)
    motors, found = standing_load(cfg, load=0.0, hold=False, seconds=0.5)
    held, _ = standing_load(cfg, load=0.0, hold=True, seconds=0.5)
    calves = motors.torque_square[2::3]
    expected = (12.6 * 9.81 / 4.0 * 0.213 * np.sin(0.7)) ** 2
    # the quarter is a mean over legs that differ, and includes the leg's own weight, which no knee carries
    assert calves.mean() == pytest.approx(expected, rel=0.2)
    assert found["height"] == pytest.approx(0.334, abs=0.003)
    assert held.torque_square[2::3].mean() < 0.01 * calves.mean()
    assert 0.0 < held.coil.sum() < 5.0


@pytest.mark.parametrize("command", ["walk", "mission"])
@pytest.mark.parametrize(
    ("content", "message"),
    [
        (b"[" * 100_000, "not JSON"),
        (b'{"electrical": ' * 2000, "not JSON"),
        (b'{"electrical": {', "not JSON"),
        (b"\xff\xfe", "not JSON"),
        (b'{"electrical": {"regeneration": 0, "regeneration": 1}}', "regeneration stands twice"),
        (b'{"electrical": {"regeneration": 1' + 400 * b"0" + b"}}", "regeneration = inf is out of range"),
        (b'{"electrical": {"regeneration": [[[]]]}}', "is not a number"),
        (b"[]", "one object per group"),
    ],
)
def test_unusable_numbers_end_with_2(
    command: str, content: bytes, message: str, tmp_path: Path, refused: Refused
) -> None:
    """A file of ``--numbers`` that is damaged, nested without end or out of range: one line, no traceback."""
    file = tmp_path / "numbers.json"
    file.write_bytes(content)
    assert message in refused(command, "--out", tmp_path / "out", "--numbers", file)
    assert not (tmp_path / "out").exists()


def test_numbers_that_were_given_are_not_called_calibrated() -> None:
    """A default came from ``--calibrate``; another value only if this run fitted it."""
    groups = {"electrical": ElectricalCfg(electronics=50.0)}
    found = model_numbers.described(groups)["electrical"]
    assert (found["electronics"]["calibrated"], found["electronics"]["source"]) == (
        False,
        "given by --numbers or --set",
    )
    assert found["winding_resistance"]["calibrated"] and not found["calf_gear"]["calibrated"]
    fitted = model_numbers.described(groups, ("electrical.electronics",))["electrical"]["electronics"]
    assert fitted["calibrated"] and fitted["fitted_in_this_run"] and fitted["source"].startswith("calibrated on Go1")
