"""Causes named from an arm's log; the truth is simulated by :mod:`tests.robot_logs.arm_log`."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import mujoco
import numpy as np
import pytest
from threadpoolctl import threadpool_info, threadpool_limits

from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs import robot_diagnosis
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import LogError, load_log
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robot_logs.selection import select
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.sysid.last_gate import Change
from mrwarp.sysid.settings import Robot, Settings
from mrwarp.sysid.verdict import Value
from tests.robot_logs.arm_log import arm_log, six_joint_log
from tests.robot_logs.made_likelihood import made_likelihood, made_parameter

BETWEEN = 0.0005
"""Half a step of the replay, 1 ms: what its semi-implicit steps may come later than the truth's finer ones [s]."""


def half(number: Value) -> float:
    """Half of a number's 95 % interval."""
    return 0.5 * (number.ci95[1] - number.ci95[0])


@pytest.fixture(scope="module")
def healthy_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of an arm as described."""
    return arm_log(tmp_path_factory.mktemp("healthy"), seconds=2.8)


@pytest.fixture(scope="module")
def late_arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RobotDiagnosis, dict[str, Any]]:
    """Log of an arm whose commands act 14 ms late, its diagnosis, and by function what was found before sizes."""
    folder, found = arm_log(tmp_path_factory.mktemp("late"), seconds=2.8, late=0.014), {}

    def noted(name: str) -> Callable:
        taken = getattr(robot_diagnosis, name)
        return lambda *args: found.setdefault(name, taken(*args))

    with pytest.MonkeyPatch.context() as patched:
        for name in ("first_look", "_judged"):
            patched.setattr(robot_diagnosis, name, noted(name))
        return folder, _diagnosed(folder), found


def test_a_healthy_log_has_no_cause(healthy_arm: Path) -> None:
    """Another step, cones and noise than the replay's; a command acts at once, which is no negative delay."""
    first: list[RobotDiagnosis] = []
    d = diagnose_log(healthy_arm / "arm.xml", load_log(healthy_arm), answered=lambda early: not first.append(early))
    assert (d.verdict, d.causes) == ("none", ())
    assert first[0].suspects == () and "no single fault" in first[0].sentence
    assert not np.any(d.theta)
    assert {"trunk_mass", "backlash"} <= {text.partition(":")[0] for text in d.cannot_know}
    assert d.next_experiment is not None and "walk" not in "".join((d.next_experiment.what, *d.cannot_know))


def test_settings_decide(tmp_path: Path) -> None:
    """Higher odds name less, and so does a cause that must recur more clearly; a verdict takes as many windows."""
    p = made_parameter(step=0.1, spread=0.02, least=0.05, fault=1.0)
    size = 0.2 + np.random.default_rng(0).normal(0.0, 0.1, 64)
    seen = made_likelihood(np.full((64, 1, 1), 4e3), 4e3 * size[:, None])
    for robot, count in ((Robot(), 1), (Robot(odds=1e3), 0), (Robot(recurrence=99.0), 0)):
        assert len(select(replace(seen, settings=Settings(robot=robot)), [p])) == count, robot
    log = arm_log(tmp_path, seconds=2.0)
    with pytest.raises(LogError, match="900 are needed"):
        diagnose_log(log / "arm.xml", load_log(log), settings=Settings(robot=Robot(windows=900)))


def test_products_of_small_matrices_take_one_thread(monkeypatch: pytest.MonkeyPatch) -> None:
    """With two, each waits for the core of the other, which replays: on a full machine they take ten times as long."""
    seen: list[int] = []

    def replay_model(*_) -> None:  # noqa: ANN002
        seen.extend(x["num_threads"] for x in threadpool_info() if x["user_api"] == "blas")
        raise LogError("enough")

    monkeypatch.setattr(robot_diagnosis, "replay_model", replay_model)
    with threadpool_limits(2, "blas"), pytest.raises(LogError, match="enough"):
        diagnose_log(Path("arm.xml"), SimpleNamespace(notes=()))
    assert seen and set(seen) == {1}


@pytest.mark.slow
def test_an_arm_of_six_joints_takes_less_than_a_minute(tmp_path: Path) -> None:
    """40 s of log on two threads, by the processor's time of both; dry friction of its elbow is named, and no walk."""
    log, begun = load_log(six_joint_log(tmp_path)), time.process_time()
    d = diagnose_log(tmp_path / "arm.xml", log)
    assert time.process_time() - begun < 60.0
    (cause,) = d.causes
    assert (cause.name, cause.where) == ("coulomb_friction", "j2")
    assert 0.8 == pytest.approx(cause.parameters["torque"].value, abs=half(cause.parameters["torque"]))
    assert "walk" not in "".join(d.cannot_know)


@pytest.mark.slow
def test_gains_that_the_log_does_not_tell_come_back(tmp_path: Path) -> None:
    """The robot's Kp is 15, the log says 12."""
    d = _diagnosed(arm_log(tmp_path, seconds=8.0, kp=15.0))
    found = {c.where: c.parameters["gain"] for c in d.causes if c.name == "kp"}
    assert list(found) == ["robot"] and found["robot"].value == pytest.approx(15.0, abs=half(found["robot"]))


def test_torques_of_all_drives_together_cannot_be_known_in_the_air(
    healthy_arm: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Logged gains are 0.85 times the robot's, as masses too small would look: no cause, and reported so.

    The note has two decimals, of a size that is known to four of its standard errors.
    """
    log, notes, known = load_log(healthy_arm), robot_diagnosis._notes, []
    monkeypatch.setattr(robot_diagnosis, "_notes", lambda *args: known.append(args[-1]) or notes(*args))
    d = diagnose_log(healthy_arm / "arm.xml", replace(log, kp=0.85 * log.kp, kd=0.85 * log.kd))
    assert d.causes == ()
    assert any(text.startswith("motor_strength of robot: up to some 20 %") for text in d.cannot_know)
    (note,) = (text for text in d.notes if text.startswith("all drives' torques are "))
    scale = next(k for k, p in enumerate(d.parameters) if p.field == "scale")
    error = np.sqrt(known[0].covariance[scale, scale])
    assert float(note.split()[4]) == pytest.approx(1.0 / 0.85, abs=0.005 + 4.0 * error)


@pytest.mark.slow
def test_torques_of_all_drives_further_off_are_the_motors_strength(healthy_arm: Path) -> None:
    """The log says half the robot's gains: no masses of links are wrong by as much."""
    log = load_log(healthy_arm)
    d = diagnose_log(healthy_arm / "arm.xml", replace(log, kp=0.5 * log.kp, kd=0.5 * log.kd))
    assert [(c.name, c.where) for c in d.causes] == [("motor_strength", "robot")]
    assert d.causes[0].parameters["factor"].value == pytest.approx(2.0, abs=half(d.causes[0].parameters["factor"]))


def test_a_delay_of_more_than_a_row_is_named(late_arm: tuple[Path, RobotDiagnosis, dict[str, Any]]) -> None:
    """Commands act 14 ms late; a row is 5 ms."""
    _, d, _ = late_arm
    assert [(c.name, c.where) for c in d.causes] == [("command_delay", "robot")]
    delay = d.causes[0].parameters["delay"]
    assert delay.value == pytest.approx(0.014, abs=half(delay) + BETWEEN)
    assert d.sentence == f"commands act {1e3 * delay.value:.1f} ms late."


@pytest.mark.slow
def test_a_weight_off_a_link_is_its_mass_and_its_static_moment(tmp_path: Path) -> None:
    """0.3 kg at the lower link's end, 50 mm to its side, and nothing else: no drive or joint stands for it."""
    more, off = 0.3, np.array([0.05, 0.0, -0.125])

    def weighed(model: mujoco.MjModel) -> None:
        mass = model.body_mass[2]
        model.body_mass[2], model.body_ipos[2] = mass + more, model.body_ipos[2] + more / (mass + more) * off
        model.body_inertia[2] += mass * more / (mass + more) * (off @ off)  # the arm moves about one axis

    d = _diagnosed(arm_log(tmp_path, seconds=8.0, change=weighed))
    found = {(c.name, c.where, name): x for c in d.causes for name, x in c.parameters.items()}
    true = {("link_mass", "mass"): more, ("link_com", "x"): more * off[0], ("link_com", "z"): more * off[2]}
    assert set(found) == {(cause, "lower", name) for cause, name in true}
    for (cause, name), value in true.items():
        number = found[cause, "lower", name]
        assert number.value == pytest.approx(value, abs=half(number)), cause


@pytest.mark.parametrize(
    ("interval", "after", "said"),
    [
        ((-0.1, 0.5), 1.0, "does not clearly fall"),
        (None, 1.1, "of qd grows"),
    ],
)
def test_causes_that_gain_nothing_or_cost_a_channel_are_not_named(
    interval: tuple[float, float] | None,
    after: float,
    said: str,
    late_arm: tuple[Path, RobotDiagnosis, dict[str, Any]],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Each of them may be clear, yet all together lead the replay astray, or one channel pays for the others."""
    (folder, _, before), held_out, seen = late_arm, robot_diagnosis.held_out, []
    for name, found in before.items():  # the diagnosis from there on
        monkeypatch.setattr(robot_diagnosis, name, lambda *_, found=found: found)

    def worse(*args):  # noqa: ANN002, ANN202
        gain, errors, channels = held_out(*args)
        seen.append(gain.ci95)
        if len(seen) == 1:
            channels = {**channels, "qd": Change(before=1.0, after=after)}
            gain = replace(gain, ci95=interval or gain.ci95)
        return gain, errors, channels

    monkeypatch.setattr(robot_diagnosis, "held_out", worse)
    d = _diagnosed(folder)
    assert seen[0][0] > 0.5 and seen[1] == pytest.approx((0.0, 0.0), abs=1e-12)  # without it, the delay is right
    assert (d.verdict, d.causes) == ("none", ())
    assert said in {s.name: s.reason for s in d.suspects}["command_delay"]
    assert not np.any(d.theta)


@pytest.mark.slow
def test_commands_that_act_before_their_row_were_stamped_late(healthy_arm: Path) -> None:
    """Their column stands 3 rows of 5 ms further down than it was given: no delay, for no command acts before it is."""
    log = load_log(healthy_arm)
    late = [replace(run, joint={**run.joint, "q_des": np.roll(run.joint["q_des"], 3, axis=0)}) for run in log.runs]
    d = diagnose_log(healthy_arm / "arm.xml", replace(log, runs=tuple(late)))
    assert [(c.name, c.where) for c in d.causes] == [("clock_shift", "commands")]
    shift = d.causes[0].parameters["shift"]
    assert shift.value == pytest.approx(0.015, abs=half(shift) + BETWEEN)


def test_a_torque_of_no_cause_is_unexplained_with_joint_and_time(tmp_path: Path) -> None:
    """For 1.8 s something turns the elbow, whose torque is found to a tenth; no cause is blamed for it."""

    def gust(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:  # noqa: ARG001
        return np.array([0.0, 0.6 * (1.8 < t < 3.6)])

    d = _diagnosed(arm_log(tmp_path, seconds=5.0, seed=3, extra=gust))
    assert (d.verdict, d.causes) == ("unexplained", ())
    found = d.to_dict()["unexplained"]
    assert found["where"] == "elbow" and found["peak"][0] == pytest.approx(0.6, rel=0.1)
    assert [name for name, _, _ in found["when"]] == ["run0", "run1"]
    assert found["when"][0][1:] == pytest.approx((1.8, 3.6), abs=0.61)  # windows of 0.6 s, whole ones
    assert "outside the catalogue: a torque in elbow" in d.sentence


@pytest.mark.slow
def test_friction_that_a_controller_compensates_is_told(tmp_path: Path) -> None:
    """The compensation of 80 % of the elbow's friction stands in no command."""

    def helped(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:  # noqa: ARG001
        return np.array([0.0, 0.08 * np.tanh(v[1] / 0.02)])

    d = _diagnosed(arm_log(tmp_path, seconds=2.8, extra=helped))
    assert [(c.name, c.where) for c in d.causes] == [("coulomb_friction", "elbow")]
    # to a tenth of the friction that is described, whose constraint gives way otherwise in the truth
    assert d.causes[0].parameters["torque"].value == pytest.approx(-0.08, abs=0.1 * 0.1)
    assert any(note.startswith("less friction than described at elbow") for note in d.notes)


@pytest.mark.slow
def test_a_dead_coil_is_named_from_six_seconds_of_walking(tmp_path: Path) -> None:
    """Its current is missing, and nothing else is blamed: loads move to neighbouring legs, whose devices are well."""
    cfg = LogCfg(robot="mr_go", motions=(("walk", 6.0),), hide=("coil_dead=RL",), policy=DEFAULT_POLICY, seed=1)
    with contextlib.suppress(OSError):
        record(cfg, tmp_path)
    d = diagnose_log(Path("mr_go"), load_log(tmp_path))
    assert [(c.name, c.where) for c in d.causes] == [("coil_dead", "RL_calf")]
    assert d.causes[0].parameters["factor"].value < 0.01  # no current at all
    assert d.per_channel["current"]["extended"] < 0.3 * d.per_channel["current"]["baseline"]


@pytest.mark.slow
def test_a_healthy_robot_that_squats_has_no_cause(tmp_path: Path) -> None:
    """No foot lifts: what lengths, inertias and floor would share is not blamed on any of them."""
    record(LogCfg(robot="mr_go", motions=(("stand", 1.0), ("squat", 4.5)), seed=7), tmp_path)
    d = diagnose_log(Path("mr_go"), load_log(tmp_path))
    assert (d.verdict, d.causes) == ("none", ())


def _diagnosed(folder: Path) -> RobotDiagnosis:
    return diagnose_log(folder / "arm.xml", load_log(folder))
