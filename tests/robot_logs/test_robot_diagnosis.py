"""Causes named from an arm's log; the truth is simulated by :mod:`tests.robot_logs.arm_log`."""

import contextlib
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.signal import savgol_filter
from threadpoolctl import threadpool_info, threadpool_limits

from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs import robot_diagnosis, robot_fit, robot_proof, robot_verdict
from mrwarp.robot_logs.causes.parameter import Parameter, parameters_of
from mrwarp.robot_logs.initial_guess import initial_guess
from mrwarp.robot_logs.likelihood import Likelihood, Slopes, _currents_alone, gather, replayed
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_fit import FirstLook, fitted_alone, searched
from mrwarp.robot_logs.robot_log import LogError, RobotLog, load_log
from mrwarp.robot_logs.robot_verdict import RobotDiagnosis
from mrwarp.robot_logs.selection import (
    Found,
    Hypothesis,
    bounds_of,
    bounds_without,
    half_width,
    posterior,
    prior_of,
    select,
    sizes,
)
from mrwarp.robot_logs.slopes import CREEP
from mrwarp.robot_logs.virtual.record_log import SETTLE, LogCfg, record
from mrwarp.robot_logs.virtual.true_robot import TrueRobot
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, _coil_current, nuisances
from mrwarp.robot_logs.windows import SPEED_STEPS, cut_windows, held_rows
from mrwarp.sysid.last_gate import Change
from mrwarp.sysid.settings import Robot, Settings
from mrwarp.sysid.verdict import Value
from tests.robot_logs.arm_log import arm_log, six_joint_log

BETWEEN = 0.0005
"""Half a step of the replay, 1 ms: what its semi-implicit steps may come later than the truth's finer ones [s]."""


def half(number: Value) -> float:
    """Half of a number's 95 % interval."""
    return 0.5 * (number.ci95[1] - number.ci95[0])


@pytest.fixture(scope="module")
def healthy_arm(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Log of an arm as described."""
    return arm_log(tmp_path_factory.mktemp("healthy"), seconds=3.5)


@pytest.fixture(scope="module")
def late_arm(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, RobotDiagnosis, dict[str, Any]]:
    """Log of an arm whose commands act 14 ms late, its diagnosis, and by function what was found before sizes."""
    folder, found = arm_log(tmp_path_factory.mktemp("late"), seconds=3.5, late=0.014), {}

    def noted(name: str) -> Callable:
        taken = getattr(robot_diagnosis, name)
        return lambda *args: found.setdefault(name, taken(*args))

    with pytest.MonkeyPatch.context() as patched:
        for name in ("first_look", "_judged"):
            patched.setattr(robot_diagnosis, name, noted(name))
        return folder, _diagnosed(folder), found


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotLog, list[tuple[float, ...]]]:
    """Log of 4 s of walking with motion capture; time and what the devices remember, at each of the robot's steps."""
    folder, true, own = tmp_path_factory.mktemp("walked"), [], TrueRobot.advance

    def noted(robot: TrueRobot, seconds: float) -> None:
        own(robot, seconds)
        true.append((robot.time, *robot.z))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(TrueRobot, "advance", noted)
        walk = (("walk", 4.0),)
        record(LogCfg(robot="mr_go", motions=walk, policy=DEFAULT_POLICY, seed=1, motion_capture=True), folder)
    return load_log(folder), true


@pytest.fixture(scope="module")
def stood(tmp_path_factory: pytest.TempPathFactory) -> RobotLog:
    """Log of 4 s of standing with motion capture."""
    folder = tmp_path_factory.mktemp("stood")
    record(LogCfg(robot="mr_go", motions=(("stand", 4.0),), seed=1, motion_capture=True), folder)
    return load_log(folder)


def blind(log: RobotLog) -> RobotLog:
    """The log without motion capture."""
    base = ({name: x for name, x in run.base.items() if name not in ("pos", "vel")} for run in log.runs)
    return replace(log, runs=tuple(replace(run, base=seen) for run, seen in zip(log.runs, base, strict=True)))


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
    p = replace(_parameter(), step=0.1, spread=0.02, least=0.05, fault=1.0)
    size = 0.2 + np.random.default_rng(0).normal(0.0, 0.1, 64)
    seen = _likelihood(np.full((64, 1, 1), 4e3), 4e3 * size[:, None])
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


def test_torques_of_all_drives_further_off_are_the_motors_strength(healthy_arm: Path) -> None:
    """The log says half the robot's gains: no masses of links are wrong by as much."""
    log = load_log(healthy_arm)
    d = diagnose_log(healthy_arm / "arm.xml", replace(log, kp=0.5 * log.kp, kd=0.5 * log.kd))
    assert [(c.name, c.where) for c in d.causes] == [("motor_strength", "robot")]
    assert d.causes[0].parameters["factor"].value == pytest.approx(2.0, abs=half(d.causes[0].parameters["factor"]))


def test_larger_kp_of_all_joints_is_smaller_kd_with_stronger_motors(tmp_path: Path) -> None:
    """Two names of one robot: the replay cannot distinguish them, so one is tried from the other's size.

    Both of it move by rounding alone: in its torque, so in its angle by that over Kp, twice where it overshoots.
    """
    log = load_log(arm_log(tmp_path, seconds=2.0))
    model = replay_model(tmp_path / "arm.xml", log)
    parameters, (windows, *_) = parameters_of(model, log), cut_windows(model, log)
    kp, kd = (
        Hypothesis(cause=name, where="robot", members=tuple(k for k, p in enumerate(parameters) if p.cause == name))
        for name in ("kp", "kd")
    )
    theta = np.zeros((3, len(parameters)))
    theta[1, [*kp.members, kd.members[0]]] = 0.4, 0.41, 0.05
    twin = robot_fit._twin(kp, kd, theta[1], parameters)
    assert twin is not None and twin[list(kp.members)] == pytest.approx([1.4 / 1.405 - 1.0, 1.41 / 1.405 - 1.0])
    theta[2] = twin
    start = np.zeros((3, len(nuisances(model))))
    q = Replay(model, windows).run(ParameterBatch.of(parameters, theta, model), np.zeros(3, dtype=int), start)["q"]
    assert np.abs(q[1] - q[0]).max() > 0.01
    assert np.abs(q[2] - q[1]).max() < 16.0 * np.finfo(np.float32).eps * np.abs(q).max()  # eight numbers, twice


def test_a_known_strength_of_all_motors_is_the_torque_scale() -> None:
    """Where it is free the session's own scale is held, for one number would be split in two."""
    cause = {"nuisance": "scale", "motor_strength": "strength"}
    parameters = [replace(_parameter(), cause=name, field=field, spread=0.1) for name, field in cause.items()]
    strength = Hypothesis(cause="motor_strength", where="robot", members=(1,))
    assert prior_of(parameters, [])[0, 0] == pytest.approx(100.0)
    assert prior_of(parameters, [strength])[0, 0] > 1e7


def test_a_delay_of_more_than_a_row_is_named(late_arm: tuple[Path, RobotDiagnosis, dict[str, Any]]) -> None:
    """Commands act 14 ms late; a row is 5 ms."""
    _, d, _ = late_arm
    assert [(c.name, c.where) for c in d.causes] == [("command_delay", "robot")]
    delay = d.causes[0].parameters["delay"]
    assert delay.value == pytest.approx(0.014, abs=half(delay) + BETWEEN)
    assert d.sentence == f"commands act {1e3 * delay.value:.1f} ms late."


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


def test_commands_that_act_before_their_row_were_stamped_late(healthy_arm: Path) -> None:
    """Their column stands 3 rows of 5 ms further down than it was given: no delay, for no command acts before it is."""
    log = load_log(healthy_arm)
    late = [replace(run, joint={**run.joint, "q_des": np.roll(run.joint["q_des"], 3, axis=0)}) for run in log.runs]
    d = diagnose_log(healthy_arm / "arm.xml", replace(log, runs=tuple(late)))
    assert [(c.name, c.where) for c in d.causes] == [("clock_shift", "commands")]
    shift = d.causes[0].parameters["shift"]
    assert shift.value == pytest.approx(0.015, abs=half(shift) + BETWEEN)


def test_more_drag_than_described_is_dry_friction_or_it() -> None:
    """Nothing in a log distinguishes a device's drag from a joint's dry friction."""
    dry = replace(_parameter(), cause="coulomb_friction", spread=0.5, fault=0.5, lowest=0.0)
    drag = replace(_parameter(), cause="device_drag", spread=0.05, step=-0.05, fault=0.5, highest=0.0)
    (found,) = select(_likelihood(np.full((64, 2, 2), 4e3), np.full((64, 2), 4e3 * 0.8)), [dry, drag])
    assert (found.hypothesis.cause, [d.cause for d in found.alternatives]) == ("coulomb_friction", ["device_drag"])


def test_the_replay_leaves_what_the_evidence_says_where_a_joint_has_no_current(tmp_path: Path) -> None:
    """A joint without a device has no coil current: its missing readings are no broken replay."""
    folder = arm_log(tmp_path, seconds=4.0)
    for file in folder.glob("*.csv"):
        head, *rows = file.read_text().splitlines()
        rows = [head + ",current.elbow,current_cmd.elbow", *(row + ",0.1,0.1" for row in rows)]
        file.write_text("\n".join(rows) + "\n")
    log = load_log(folder)
    model = replay_model(folder / "arm.xml", log)
    groups, parameters = cut_windows(model, log), parameters_of(model, log)[:1]
    likelihood = gather(model, groups, parameters, np.zeros(1), print)
    assert np.isnan(groups[0].measured["current"]).any()
    assert replayed(likelihood, model, groups, parameters, np.zeros(1))[0] == pytest.approx(likelihood.at(np.zeros(1)))


def test_recordings_of_which_no_window_counts_are_not_replayed(tmp_path: Path) -> None:
    """A hand may have held the robot all along one of them."""
    log = load_log(arm_log(tmp_path, seconds=4.0))
    model = replay_model(tmp_path / "arm.xml", log)
    (windows,), parameters = cut_windows(model, log), parameters_of(model, log)[:1]
    both = gather(model, [windows, windows], parameters, np.zeros(1), print)
    count = int(both.keep[: windows.count].sum())
    kept = {name: getattr(both, name)[:count] for name in ("information", "score", "square", "weight", "run")}
    first = replace(both, keep=both.keep & (np.arange(len(both.keep)) < windows.count), **kept)
    left, _ = replayed(first, model, [windows, windows], parameters, np.zeros(1))
    assert left == pytest.approx(first.at(np.zeros(1)))


def test_intervals_cover_where_neighbouring_windows_err_alike() -> None:
    """Eight windows at a time share one error: 95 % intervals hold the truth in 90 to 98 of a hundred logs."""
    p = _parameter()
    d, rng, held = Hypothesis(cause="kp", where="a", members=(0,)), np.random.default_rng(0), []
    for _ in range(400):
        error = np.repeat(rng.normal(size=8), 8) + 0.3 * rng.normal(size=64)
        likelihood = _likelihood(np.ones((64, 1, 1)), error[:, None])
        now = posterior(likelihood, [p], [])
        size = float(sizes(likelihood.normal_equations(), [p], [d], *bounds_of([p]))[0])
        held.append(abs(size) < half_width(d.members, size, now, [p], lone=size))
    assert 0.90 <= np.mean(held) <= 0.98


def test_a_cause_whose_interval_reaches_to_no_fault_is_a_suspect() -> None:
    """A gain that one of eight parts of the log asks for is not clear; one that all ask for is."""
    p = _parameter()
    f = Found(hypothesis=Hypothesis(cause="kp", where="a", members=(0,)), z=9.0, alternatives=())

    def clear(asked: np.ndarray) -> bool:
        likelihood = _likelihood(np.ones((64, 1, 1)), np.repeat(asked, 8)[:, None])
        size = sizes(likelihood.normal_equations(), [p], [f.hypothesis], *bounds_of([p]))
        alone = robot_proof.Sizes(size=size, lone=size, wider=1.0)
        found, rejected, *_ = robot_proof.clear_ones([f], likelihood, [p], lambda _: (alone, likelihood))
        assert len(found) + len(rejected) == 1
        return bool(found)

    assert clear(np.linspace(0.9, 1.1, 8))
    assert not clear(np.array([8.0, -1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]))


def test_of_limbs_that_do_not_move_each_other_one_cause_goes_at_a_time() -> None:
    """Two causes of each of two legs stand for each other: one of each leg goes, at once, and one of each stays."""
    parameters = [replace(_parameter(), where=where) for where in ("a1", "a2", "b1", "b2")]
    found = [
        Found(hypothesis=Hypothesis(cause="kp", where=p.where, members=(k,)), z=9.0, alternatives=())
        for k, p in enumerate(parameters)
    ]
    likelihood, asked = _likelihood(np.ones((40, 4, 4)), np.zeros((40, 4))), []

    def without(now: list[Found], tried: list[Found]) -> list[np.ndarray]:
        asked.append(len(tried))
        alone = [sum(f.hypothesis.where[0] == one.hypothesis.where[0] for f in now) == 1 for one in tried]
        return [np.full(40, 10.0 if x else -1.0 - k) for k, x in enumerate(alone)]

    limbs = {p.where: p.where[0] for p in parameters}
    kept, gone = robot_proof._certain(found, without, likelihood, parameters, limbs)
    assert sorted(f.hypothesis.where[0] for f in kept) == sorted(f.hypothesis.where[0] for f in gone) == ["a", "b"]
    assert asked == [4, 2]
    asked.clear()
    assert len(robot_proof._certain(found, without, likelihood, parameters)[0]) == 2
    assert asked == [4, 3, 1]


def test_windows_in_which_a_cause_could_not_act_have_no_say() -> None:
    """A coil that was asked for current in every third window: what the others lose or gain without it is chance."""
    p = _parameter()
    f = Found(hypothesis=Hypothesis(cause="coil_dead", where="a", members=(0,)), z=9.0, alternatives=())
    acts = np.arange(60) % 3 == 0
    likelihood = _likelihood(np.where(acts, 1.0, 1e-4)[:, None, None], np.zeros((60, 1)))

    def certain(gain: np.ndarray) -> bool:
        return bool(robot_proof._certain([f], lambda *_: [gain], likelihood, [p])[0])

    assert certain(np.where(acts, 10.0, -1.0))
    assert not certain(np.where(acts, np.where(np.arange(60) % 2, 10.0, -8.0), 5.0))


def test_many_unlikely_numbers_are_no_better_than_one_cause() -> None:
    """Twelve drives that all settle off their commands give the readings that one weight gives."""
    weight = Hypothesis(cause="kp", where="a", members=(0,))
    found = [Found(hypothesis=weight, z=9.0, alternatives=())]
    reading = np.array([1.0, *np.full(12, 1.0 / 12)])
    noise = np.random.default_rng(0).normal(size=64)
    likelihood = _likelihood(np.tile(np.outer(reading, reading), (64, 1, 1)), (4.0 + noise)[:, None] * reading)

    def proven(spread: float) -> bool:
        drives = [replace(_parameter(), cause="nuisance", field="shift", spread=spread) for _ in range(12)]
        return bool(robot_proof.cross_validated(found, likelihood, [replace(_parameter(), spread=0.1), *drives])[0])

    assert proven(1.5)
    assert not proven(20.0)  # as drives are: then the log does not show it


def test_a_weight_on_the_trunk_is_no_heavy_hip() -> None:
    """A hip's mass is nearly what a weight on the trunk is, by one number in place of two; a heavy hip stays one."""
    names = (("trunk_mass", "mass"), ("trunk_com", "x"), ("link_mass", "mass"))
    parameters = [replace(_parameter(), cause=c, name=n, spread=0.02, fault=1.0) for c, n in names]
    readings = np.array([[1.0, 0.0, 0.8], [0.0, 1.0, 0.8]])

    def named(truth: tuple[float, ...]) -> list[tuple[str, str]]:
        a = np.tile(readings.T @ readings * 100.0, (64, 1, 1))
        noise = 10.0 * np.random.default_rng(0).normal(size=(64, 2)) @ readings
        found = select(_likelihood(a, a[0] @ truth + noise), parameters)
        return [(f.hypothesis.cause, parameters[f.hypothesis.members[0]].name) for f in found]

    assert named((1.0, 0.5, 0.0)) == [("trunk_mass", "mass"), ("trunk_com", "x")]
    assert named((0.0, 0.0, 1.0)) == [("link_mass", "mass")]


def test_rounds_end_where_two_sets_of_causes_ask_for_each_other(monkeypatch: pytest.MonkeyPatch) -> None:
    """The fit with the first asks for the second and back: each is fitted once, the likelier one stands."""
    first, second = (Hypothesis(cause="link_mass", where=x, members=(k,)) for k, x in enumerate("ab"))
    asked, fitted = [], []
    likelihood = _likelihood(np.ones((8, 2, 2)), np.zeros((8, 2)))

    def select(*_) -> list[Found]:  # noqa: ANN002
        asked.append((first, second)[len(asked) % 2])
        return [Found(hypothesis=asked[-1], z=9.0, alternatives=())]

    def fit(*args) -> tuple[np.ndarray, Likelihood, bool]:  # noqa: ANN002
        fitted.append(asked[-1])
        return np.eye(2)[asked[-1].members[0]], args[4], True

    def replayed(likelihood: Likelihood, *args) -> tuple[float, Likelihood]:  # noqa: ANN002
        return 100.0 * float(args[-1][1]), likelihood  # the second's fit is worse

    stubs = {
        "gather": lambda *_: likelihood, "select": select, "fit": fit, "replayed": replayed,
        "cross_validated": lambda found, *_: (found, []), "fitted_alone": lambda *_: (np.zeros(2), likelihood, []),
    }  # fmt: skip
    for name, stub in stubs.items():
        monkeypatch.setattr(robot_fit, name, stub)
    look = FirstLook(nuisance=np.zeros(2), described=likelihood, guess=np.zeros(2), guessed=[])
    theta, free, *_ = robot_fit.fitted(SimpleNamespace(free=True), [], [_parameter(), _parameter()], print, look)
    assert fitted == [first, second]
    assert free == [first] and theta.tolist() == [1.0, 0.0]


@pytest.mark.parametrize(("motor", "named", "rivals"), [(105.0, 0, [1]), (95.0, 1, [0]), (150.0, 0, [])])
def test_a_motor_s_strength_begins_at_the_size_of_kp_and_is_its_alternative(
    motor: float, named: int, rivals: list[int]
) -> None:
    """The replay leaves 100 with Kp: the one that leaves less is free, one that leaves little more is a rival."""
    names = ("kp", "motor_strength")
    parameters = [replace(_parameter(), cause=name) for name in names]
    kp, strength = (Hypothesis(cause=name, where="a", members=(k,)) for k, name in enumerate(names))
    likelihood, begun, found = _likelihood(np.ones((8, 2, 2)), np.zeros((8, 2))), [], {}

    def refit(hypotheses: list[Hypothesis], sizes: dict[int, float], _: None) -> tuple[np.ndarray, Likelihood, bool]:
        begun.append((hypotheses, sizes))
        return np.array([-0.2, 0.0] if hypotheses == [kp] else [0.0, -0.2]), likelihood, True

    _, free, *_ = robot_fit._one_drive(
        np.array([-0.2, 0.0]), [kp], likelihood, True, parameters, refit, lambda x, _: 100.0 if x[0] else motor, found
    )
    assert begun == [([strength], {1: -0.2}), ([(strength, kp)[named]], None)]
    assert free == [(kp, strength)[named]]
    assert found == {free[0]: [(kp, strength)[k] for k in rivals]}


def test_a_drive_s_cause_goes_on_from_where_the_fit_of_another_came() -> None:
    """A fit that stopped early is no verdict: Kp leaves 100 by its own way, a motor 90, and Kp 80 from there."""
    parameters = [
        replace(_parameter(), cause=cause, field=field, index=0)
        for cause, field in (("kp", "kp"), ("kd", "kd"), ("motor_strength", "strength"))
    ]
    kp, kd, motor = (Hypothesis(cause=p.cause, where="a", members=(k,)) for k, p in enumerate(parameters))
    likelihood = _likelihood(np.ones((8, 3, 3)), np.zeros((8, 3)))
    leaves = {kd: 120.0, motor: 90.0}

    def refit(
        hypotheses: list[Hypothesis], sizes: dict[int, float] | None, twin: np.ndarray | None
    ) -> tuple[np.ndarray, Likelihood, bool]:
        theta = np.array([0.0, 0.1, -0.19]) if twin is None else twin
        return np.append(theta, leaves[hypotheses[0]] if twin is None else 80.0), likelihood, True

    theta, free, *_ = robot_fit._one_drive(
        np.array([-0.2, 0.0, 0.0, 100.0]), [kp], likelihood, True, parameters, refit, lambda x, _: x[-1], {}
    )
    assert free == [kp]
    same = (1.0 + theta[2]) * (1.0 + theta[:2])
    assert same == pytest.approx([0.81, 0.81 * 1.1])  # the same drive, the other two as healthy as can be
    assert theta[1:3] == pytest.approx(np.sqrt(0.81 * 1.1) - 1.0)


@pytest.mark.parametrize(("size", "scale", "named"), [(-0.4, 0.4, "kd"), (-0.4, -0.1, "kp"), (0.5, -0.25, "kd")])
def test_of_kp_and_kd_the_likelier_with_its_torque_scale_is_named(size: float, scale: float, named: str) -> None:
    """They are one robot but for that scale: the fit, which came to Kp of all joints, does not say which of them."""
    fields = {"kp": ("kp", 0.3), "kd": ("kd", 0.5), "nuisance": ("scale", 0.0)}
    parameters = [
        replace(_parameter(), cause=cause, where=where, field=field, fault=fault, spread=0.1, lowest=-0.3, highest=0.41)
        for cause, (field, fault) in fields.items()
        for where in ("ab" if cause != "nuisance" else ["robot"])
    ]
    both = {x: Hypothesis(cause=x, where="robot", members=m) for x, m in (("kp", (0, 1)), ("kd", (2, 3)))}
    kp = Found(hypothesis=both["kp"], z=9.0, alternatives=(both["kd"],))
    begin, odds = np.array([size, size, 0.0, 0.0, scale]), Settings().odds.rival
    (found,), theta = robot_fit.likelier([kp], begin, parameters, odds)
    assert found.hypothesis == both[named]
    if named == "kd":
        own = 1.0 / (1.0 + size) - 1.0
        assert found.alternatives == (both["kp"],)
        assert theta == pytest.approx([0.0, 0.0, own, own, (1.0 + size) * (1.0 + scale) - 1.0], abs=1e-9)


@pytest.mark.parametrize("confirmed", [[], [1]])
def test_a_drive_s_cause_is_the_one_that_the_replay_needed(confirmed: list[int]) -> None:
    """Derivatives ask for Kp; the fit by the replay was as good with the motor's strength alone, and it stands."""
    names = ("kp", "motor_strength")
    parameters = [replace(_parameter(), cause=name, spread=0.01, fault=1.0, least=0.01) for name in names]
    both = [Hypothesis(cause=name, where="a", members=(k,)) for k, name in enumerate(names)]
    a = np.tile(1e5 * np.array([[1.0, 0.999], [0.999, 1.0]]), (16, 1, 1))
    found = select(_likelihood(a, a @ np.array([0.2, 0.0])), parameters, [both[k] for k in confirmed])
    assert [f.hypothesis for f in found] == [both[k] for k in confirmed or [0]]


@pytest.mark.parametrize("own", [0.3, 0.6])
def test_a_joint_s_gain_beside_that_of_all_joints_is_one_that_differs(own: float) -> None:
    """All joints' Kp is 0.3 off: one that is as much off is no cause of its own."""
    parameters = [replace(_parameter(), where=where, spread=0.02, fault=0.3, least=0.02) for where in "abcd"]
    truth, a = np.array([own, 0.3, 0.3, 0.3]), np.tile(1e3 * np.eye(4), (64, 1, 1))
    noise = np.random.default_rng(0).normal(0.0, 3.0, (64, 4))
    likelihood = replace(_likelihood(a, a @ truth + noise), square=np.full(64, truth @ a[0] @ truth))
    wide, one = (Hypothesis(cause="kp", where=w, members=m) for w, m in (("robot", (0, 1, 2, 3)), ("a", (0,))))
    found, _ = robot_proof.cross_validated(
        [Found(hypothesis=d, z=9.0, alternatives=()) for d in (wide, one)], likelihood, parameters
    )
    assert [f.hypothesis for f in found] == [wide, one][: 1 + (own != 0.3)]


def test_what_all_joints_have_in_common_is_told_without_the_one_that_differs() -> None:
    """Kp is 1.3 times the description's at all joints, but 1.6 times at the first."""
    parameters = [replace(_parameter(), where=where, nominal=1.0) for where in "abcd"]
    truth, a = np.array([0.6, 0.31, 0.30, 0.29]), np.tile(1e3 * np.eye(4), (64, 1, 1))
    likelihood, free = _likelihood(a, a @ truth), []
    for where, members in (("robot", (0, 1, 2, 3)), ("a", (0,))):
        free.append(Hypothesis(cause="kp", where=where, members=members))
    found = [Found(hypothesis=d, z=9.0, alternatives=()) for d in free]
    about = robot_proof.Sizes(size=truth, lone=truth, wider=1.0)
    named = [
        robot_verdict.named_cause(f, found, about, likelihood, parameters, posterior(likelihood, parameters, free))
        for f in found
    ]
    assert [c.parameters["factor"].value for c in named] == pytest.approx([1.3, 1.6])


def _parameter() -> Parameter:
    """A number that any size of a fault can have."""
    size = {"step": 1.0, "spread": 1e3, "least": 0.0, "fault": 1e3}
    return Parameter(cause="kp", where="a", name="gain", unit="1", field="kp", index=0, **size)


def _likelihood(a: np.ndarray, b: np.ndarray) -> Likelihood:
    """Of W windows, shapes (W, P, P) and (W, P)."""
    count = len(a)
    return Likelihood(
        information=a,
        score=b,
        square=np.zeros(count),
        weight=np.ones(count),
        scale=1.0,
        sigma={},
        samples=count,
        run=np.zeros(count),
        lost=0,
        keep=np.ones(count, dtype=bool),
    )


def test_a_torque_of_no_cause_is_unexplained_with_joint_and_time(tmp_path: Path) -> None:
    """For 2.5 s something turns the elbow, whose torque is found to a tenth; no cause is blamed for it."""

    def gust(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:  # noqa: ARG001
        return np.array([0.0, 0.6 * (3.0 < t < 5.5)])

    d = _diagnosed(arm_log(tmp_path, seconds=8.0, seed=3, extra=gust))
    assert (d.verdict, d.causes) == ("unexplained", ())
    found = d.to_dict()["unexplained"]
    assert found["where"] == "elbow" and found["peak"][0] == pytest.approx(0.6, rel=0.1)
    assert [name for name, _, _ in found["when"]] == ["run0", "run1"]
    assert found["when"][0][1:] == pytest.approx((3.0, 5.5), abs=0.61)  # windows of 0.6 s, whole ones
    assert "outside the catalogue: a torque in elbow" in d.sentence


def test_friction_that_a_controller_compensates_is_told(tmp_path: Path) -> None:
    """The compensation of 80 % of the elbow's friction stands in no command."""

    def helped(t: float, q: np.ndarray, v: np.ndarray) -> np.ndarray:  # noqa: ARG001
        return np.array([0.0, 0.08 * np.tanh(v[1] / 0.02)])

    d = _diagnosed(arm_log(tmp_path, seconds=3.5, extra=helped))
    assert [(c.name, c.where) for c in d.causes] == [("coulomb_friction", "elbow")]
    # to a tenth of the friction that is described, whose constraint gives way otherwise in the truth
    assert d.causes[0].parameters["torque"].value == pytest.approx(-0.08, abs=0.1 * 0.1)
    assert any(note.startswith("less friction than described at elbow") for note in d.notes)


def test_windows_of_a_walk_begin_where_speeds_are_known(
    walked: tuple[RobotLog, list[tuple[float, ...]]],
) -> None:
    """Averaged over some samples, a joint's speed is wrong by 1 rad/s where a foot lands: no window begins there.

    The trunk's speed is that of feet that bear load, by their forces or by their height, which roll on the ground: a
    foot about to land, 8 mm above the lowest, gave errors of 0.4 m/s. Errors are those that a start may have, up to
    four times where its spread is. Its height is that of feet that sink in by up to the millimetre of solimp's width.
    """
    log, _ = walked
    (run,), (unseen,) = log.runs, blind(log).runs
    true = run.base["vel"]
    model = replay_model(Path("mr_go"), log)
    joints, trunk = SPEED_STEPS
    for seen, most in ((unseen, trunk), (replace(unseen, feet={}), 4.0 * trunk)):
        (group,) = cut_windows(model, replace(log, runs=(seen,)))
        qd = run.joint["qd"]
        wrong = np.abs(savgol_filter(qd, 5, 2, axis=0) - qd).max(axis=1)
        assert wrong.max() > 1.0 and wrong[group.start].max() < 4.0 * joints
        off = np.abs(group.root[:, 7:10] - true[group.start]).max(axis=1)
        assert np.percentile(off, 95) < most and off.max() < 1.5 * most  # one window in twenty may begin worse
        assert abs(np.mean(group.root[:, 2] - run.base["pos"][group.start, 2])) < 0.001


def test_a_robot_begins_as_it_stands_under_a_hypothesis(tmp_path: Path) -> None:
    """A gyroscope's bias is taken off what was read, and where an encoder is wrong the trunk moves with its feet."""
    cfg = LogCfg(
        robot="mr_go",
        motions=(("walk", 4.0),),
        policy=DEFAULT_POLICY,
        seed=1,
        hide=("encoder_offset=FR_hip:0.04", "gyro_bias=0,0,0.3"),
    )
    with contextlib.suppress(OSError):
        record(cfg, tmp_path)
    log = load_log(tmp_path)
    model = replay_model(Path("mr_go"), log)
    (group,) = cut_windows(model, log)
    bias = np.tile([0.0, 0.0, 0.3], (group.count, 1))
    wrong = []
    for size in (0.0, 0.04):
        offset = np.zeros((group.count, len(model.joints)))
        offset[:, model.joints.index("FR_hip")] = size
        changes, start = (
            ParameterBatch({"bias": bias, "offset": offset}),
            np.zeros((group.count, len(nuisances(model)))),
        )
        found = Replay(model, group).run(changes, np.arange(group.count), start)
        assert np.abs(found["gyro"][:, 0] - group.measured["gyro"][:, 0]).max() < 0.01
        assert np.abs(found["q"][:, 0] - group.measured["q"][:, 0]).max() < 1e-3
        wrong.append(np.median(np.abs(found["gyro"] - group.measured["gyro"])[:, :6]))
    assert wrong[1] < 0.8 * wrong[0]


@pytest.mark.parametrize(
    ("hide", "cause", "size"),
    [("ground_stiffness=0.05", "ground_stiffness", 9.0), ("soft_foot=FL:0.05", "soft_foot", 4.0)],
)
def test_soft_ground_is_replayed_by_one_into_which_feet_sink(
    tmp_path: Path, hide: str, cause: str, size: float
) -> None:
    """The robot begins as deep in the ground as it stands there, and its legs, or one, then bear it as they did."""
    cfg = LogCfg(robot="mr_go", motions=(("walk", 4.0),), policy=DEFAULT_POLICY, seed=1, hide=(hide,))
    with contextlib.suppress(OSError):
        record(cfg, tmp_path)
    log = load_log(tmp_path)
    model = replay_model(Path("mr_go"), log)
    (group,) = cut_windows(model, log)
    own = [p for p in parameters_of(model, log) if p.cause == cause][:1]
    assert own[0].is_nuisance == (cause == "ground_stiffness")
    assert own[0].absolute(size) == pytest.approx(1.0 / (1.0 + size))
    wrong = []
    for change in (0.0, size):
        changes = ParameterBatch.of(own, np.full((group.count, 1), change), model)
        start = np.zeros((group.count, len(nuisances(model))))
        found = Replay(model, group).run(changes, np.arange(group.count), start)
        wrong.append(np.median(np.abs(found["gyro"] - group.measured["gyro"])))
    assert wrong[1] < 0.8 * wrong[0]


def test_feet_of_a_robot_that_stands_do_not_creep(stood: RobotLog) -> None:
    """Drives that press its feet outwards do not spread its legs, though the trunk may sway.

    By no more than its hips drift while it stands: half of what a drift may be.
    """
    log = blind(stood)
    model = replay_model(Path("mr_go"), log)
    (group,) = cut_windows(model, log)
    hips = [k for k, joint in enumerate(model.joints) if joint.endswith("hip")]
    shift = np.zeros((group.count, len(model.joints)))
    outwards = np.array([1.0 if model.joints[k].startswith(("FL", "RL")) else -1.0 for k in hips])
    shift[:, hips] = 0.02 * outwards
    start = np.zeros((group.count, len(nuisances(model))))
    q = Replay(model, group).run(ParameterBatch({"shift": shift}), np.arange(group.count), start)["q"][:, :, hips]
    moved = q[:, -1] - q[:, group.t.shape[1] // 2]
    seconds = group.t[:, -1] - group.t[:, group.t.shape[1] // 2]
    assert abs(np.median((moved * outwards).mean(axis=1))) < 0.5 * CREEP * seconds.max()


def test_a_device_remembers_how_it_turned_long_before_a_window(
    walked: tuple[RobotLog, list[tuple[float, ...]]],
) -> None:
    """Started again 30 ms before each window, that of a leg which moves little had a fifth of its hysteresis."""
    log, true = blind(walked[0]), walked[1]
    model = replay_model(Path("mr_go"), log)
    (group,) = cut_windows(model, log)
    time, *memories = np.transpose(true)
    later = group.start > 200  # what was before the recording is forgotten after a second
    at = log.runs[0].t[group.start[later]] + SETTLE
    for joint, z in zip(model.devices.joint, memories, strict=True):
        known, found = np.interp(at, time, z), group.memory[later, joint]
        assert np.sqrt(np.mean((found - known) ** 2)) < 0.4 * np.sqrt(np.mean(known**2))


def test_windows_of_a_robot_at_rest_count_together_once(
    stood: RobotLog, walked: tuple[RobotLog, list[tuple[float, ...]]]
) -> None:
    """And each of a walk for itself."""
    counts = {}
    for motion, log in (("stand", blind(stood)), ("walk", blind(walked[0]))):
        (group,) = cut_windows(replay_model(Path("mr_go"), log), log)
        counts[motion] = float(group.distinct.sum()), group.count
    assert counts["stand"] == (pytest.approx(1.0, abs=0.2), Settings().robot.windows)
    assert counts["walk"][0] == counts["walk"][1]


def test_a_steady_pull_accelerates_the_robot_in_the_air(stood: RobotLog) -> None:
    """Without ground under its feet by F/m, along the world's axis: its trunk to a tenth, for legs swing against it."""
    model = replay_model(Path("mr_go"), stood)
    (group,) = cut_windows(model, stood)
    high = replace(group, root=group.root + np.eye(13)[2])
    speeds = []
    for newton in (0.0, 10.0):
        pull = np.tile([0.0, newton], (group.count, 1))
        start = np.zeros((group.count, len(nuisances(model))))
        found = Replay(model, high).run(ParameterBatch({"pull": pull}), np.arange(group.count), start)
        speeds.append(found["vel"][:, -1])
    gained = 10.0 / model.model.body_mass.sum() * group.t[0, -1]
    assert np.median(speeds[1] - speeds[0], axis=0) == pytest.approx([0.0, gained, 0.0], abs=0.1 * gained)


def test_a_torque_was_read_before_the_row_s_command_acts(tmp_path: Path) -> None:
    """Of a healthy arm whose targets step, replayed and logged torque agree at the very row of the step."""
    folder = arm_log(tmp_path, seconds=4.0)
    log = load_log(folder)
    model = replay_model(folder / "arm.xml", log)
    (group,) = cut_windows(model, log)
    count = group.count
    replay = Replay(model, replace(group, measured=group.measured | {"tau": np.zeros_like(group.measured["q"])}))
    start = np.zeros((count, len(nuisances(model))))
    found = replay.run(ParameterBatch({}), np.arange(count), start)
    kp, kd = log.kp, log.kd
    for w in range(count):
        run, first = log.runs[group.run[w]], group.start[w]
        rows = np.arange(first + 1, first + group.t.shape[1])
        q_des = run.joint["q_des"][rows - 1]
        asked = kp * (q_des - found["q"][w, 1:]) - kd * found["qd"][w, 1:]
        assert np.abs(found["tau"][w, 1:] - asked).max() < 0.2


def test_a_coil_answers_rows_between_steps_and_samples() -> None:
    """A lag of 30 ms, rows of 5 ms that act 7.3 ms late: as steps of 10 us have it; without lag, the row that holds.

    The steps take the row that holds in their middle and are exact for it, to a rounding each.
    """
    t, asked = np.arange(20) * 0.005 - 0.02, np.random.default_rng(3).uniform(0.0, 1.5, (20, 2))
    at, late, lag = np.array([0.0, 0.0041, 0.02, 0.0487]), 0.0073, 0.03
    found = _coil_current(asked, t + late, np.array([0.4, 0.4]), at, np.array([lag, 0.0]))
    fine, current, step = [], 0.4, 1e-5
    for k in range(round(0.05 / step)):
        fine.append(current)
        row = max(np.searchsorted(t + late, (k + 0.5) * step, side="right") - 1, 0)
        current -= np.expm1(-step / lag) * (asked[row, 0] - current)
    rounding = len(fine) * float(np.finfo(float).eps) * asked.max()
    assert found[:, 0] == pytest.approx(np.array(fine)[np.round(at / step).astype(int)], abs=rounding)
    held = [0.4, *(asked[np.searchsorted(t + late, x, side="right") - 1, 1] for x in at[1:])]
    assert found[:, 1] == pytest.approx(held)


def test_commands_of_a_step_are_their_mean_over_it() -> None:
    """Rows at uneven times are held until the next: a step gets of each as much as it holds in it."""
    t, x = np.array([0.0, 0.0051, 0.0099, 0.015]), np.array([[1.0], [2.0], [4.0], [8.0]])
    found = held_rows(x, t, np.array([-0.005, 0.0, 0.005, 0.01, 0.015]), 0.005)[:, 0]
    assert found == pytest.approx([1.0, 1.0, (0.1 * 1.0 + 4.8 * 2.0 + 0.1 * 4.0) / 5.0, 4.0, 8.0])


def test_a_fault_of_a_coil_cannot_hide_behind_the_robot() -> None:
    """Its current says all of it: the channel weighs by its rest after the share that currents alone ask for."""
    rng = np.random.default_rng(4)
    asked = rng.uniform(0.0, 1.5, (30, 60, 1))
    share = np.stack([-asked, np.zeros_like(asked)], axis=1).reshape(30, 2, 60)  # and a number no current shows
    read = (-asked + 0.004 * rng.standard_normal(asked.shape)).reshape(30, 60)
    slopes = Slopes(
        layout={"current": (60, 1)},
        j=share.astype(np.float32),
        z=np.zeros((30, 1, 60), np.float32),
        base=read,
        windows=SimpleNamespace(),
    )
    error = 1.0 / np.sqrt(2.0 * read.size)
    assert _currents_alone([slopes], [read])["current"] == pytest.approx([0.004], rel=4.0 * error)


def test_a_search_ends_beside_a_step(monkeypatch: pytest.MonkeyPatch) -> None:
    """A parabola through a step lies far off: the least is found by halving, and never left for a worse one.

    It lies between its neighbours, whose ratio is the root of that before each halving.
    """
    monkeypatch.setattr(robot_fit, "replayed", lambda e, m, g, p, x: (abs(x[0] - 0.9) + 1e5 * (x[0] > 0.95), None))
    found = searched(
        np.array([0.8]),
        [0],
        None,
        [],
        [_parameter()],
        SimpleNamespace(scale=1.0, settings=Settings()),
        np.zeros((1, 1)),
        np.array([0.0]),
        np.array([2.0]),
    )
    settings = Settings().robot_fit
    assert found[0] == pytest.approx(0.9, rel=settings.factor ** (0.5**settings.narrowed) - 1.0)


def test_when_commands_act_is_searched_where_derivatives_end(monkeypatch: pytest.MonkeyPatch) -> None:
    """They end at 7 ms of a delay of 12 ms, where the replay is best; the rest of a session is fitted with it."""
    p = replace(_parameter(), cause="command_delay", field="delay", least=0.0015, always_free=True)
    begun = []

    def fitted_alone(*args) -> tuple[np.ndarray, Likelihood, list[int]]:  # noqa: ANN002
        return np.maximum(args[4], 0.007), _likelihood(np.ones((8, 1, 1)), np.zeros((8, 1))), [0]

    def fit(*args) -> tuple[np.ndarray, None, bool]:  # noqa: ANN002
        begun.append(float(args[3][0]))
        return args[3], None, True

    monkeypatch.setattr(robot_fit, "fitted_alone", fitted_alone)
    monkeypatch.setattr(robot_fit, "fit", fit)
    monkeypatch.setattr(robot_fit, "replayed", lambda e, m, g, p, x: (1e9 * (x[0] - 0.012) ** 2, None))
    assert robot_fit.nuisances_of(None, [], [p])[0] == pytest.approx(0.012)
    assert begun == [pytest.approx(0.012)]


def test_a_delay_that_is_a_fault_is_no_part_of_the_error_before() -> None:
    """Every session has one, within a row: the error without the cause is that of the latest that is no fault."""
    p = replace(_parameter(), cause="command_delay", field="delay", usual=(0.0, 0.006), always_free=True)
    d = Hypothesis(cause="command_delay", where="robot", members=(0,))
    likelihood = _likelihood(np.ones((64, 1, 1)), np.full((64, 1), 0.012))
    before, after = (
        sizes(likelihood.normal_equations(), [p], own, *bounds)[0]
        for own, bounds in (([], bounds_without([p], [d])), ([d], bounds_of([p])))
    )
    assert (before, after) == (pytest.approx(0.006), pytest.approx(0.012))


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


@pytest.mark.slow
def test_a_weak_device_is_the_single_change_that_replays_best(tmp_path: Path) -> None:
    """It is none of those that derivatives about the described floor ask for most: the session is fitted first.

    A first answer has its size to a third. Rounding makes walks differ from processor to processor. In some a few
    windows decide (2 of the 7 seeds from 62001 on, on one processor), so one of three walks has to have that answer.
    """
    answers = (_first_answer(tmp_path / str(seed), seed) for seed in (62003, 62002, 62005))
    size = next(sizes for causes, sizes in answers if causes == [("device_strength", "FR_calf")])
    assert size == pytest.approx([-0.5], rel=1 / 3)


def _first_answer(folder: Path, seed: int) -> tuple[list[tuple[str, str]], list[float]]:
    """Causes with places, and sizes, of the first answer on a walk of a robot whose device at FR is half as strong."""
    motions, hide = (("walk", 6.0),), ("device_strength=FR:0.5",)
    record(LogCfg(robot="mr_go", motions=motions, hide=hide, policy=DEFAULT_POLICY, seed=seed), folder)
    log = load_log(folder)
    model = replay_model(Path("mr_go"), log)
    parameters, groups = parameters_of(model, log), cut_windows(model, log)
    theta, _, _ = fitted_alone(model, groups, parameters, [], np.zeros(len(parameters)), *bounds_of(parameters))
    floor = next(k for k, p in enumerate(parameters) if p.cause == "ground_stiffness")
    assert theta[floor] < -0.2  # the virtual robot's floor is stiffer than the description's
    likelihood = gather(model, groups, parameters, theta, print)
    guess, found = initial_guess(model, groups, parameters, likelihood, theta)
    return [(d.cause, d.where) for d in found], [float(guess[k]) for d in found for k in d.members]


def _diagnosed(folder: Path) -> RobotDiagnosis:
    return diagnose_log(folder / "arm.xml", load_log(folder))
