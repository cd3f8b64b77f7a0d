"""Windows of a log, and their replay: where they begin, what was before them, and what acts in them."""

import contextlib
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.signal import savgol_filter

from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.likelihood import Slopes, _currents_alone, gather, replayed
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import RobotLog, load_log
from mrwarp.robot_logs.slopes import CREEP
from mrwarp.robot_logs.virtual.record_log import SETTLE, LogCfg, record
from mrwarp.robot_logs.virtual.true_robot import TrueRobot
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, _coil_current, nuisances
from mrwarp.robot_logs.windows import SPEED_STEPS, Windows, cut_windows, held_rows
from mrwarp.sysid.settings import Settings
from tests.robot_logs.arm_log import arm_log


@pytest.fixture(scope="module")
def walked(tmp_path_factory: pytest.TempPathFactory) -> tuple[RobotLog, list[tuple[float, ...]]]:
    """Log of 3 s of walking with motion capture; time and what the devices remember, at each of the robot's steps."""
    folder, true, own = tmp_path_factory.mktemp("walked"), [], TrueRobot.advance

    def noted(robot: TrueRobot, seconds: float) -> None:
        own(robot, seconds)
        true.append((robot.time, *robot.z))

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(TrueRobot, "advance", noted)
        walk = (("walk", 3.0),)
        record(LogCfg(robot="mr_go", motions=walk, policy=DEFAULT_POLICY, seed=1, motion_capture=True), folder)
    return load_log(folder), true


@pytest.fixture(scope="module")
def stood(tmp_path_factory: pytest.TempPathFactory) -> RobotLog:
    """Log of 3 s of standing with motion capture."""
    folder = tmp_path_factory.mktemp("stood")
    record(LogCfg(robot="mr_go", motions=(("stand", 3.0),), seed=1, motion_capture=True), folder)
    return load_log(folder)


def blind(log: RobotLog) -> RobotLog:
    """The log without motion capture."""
    base = ({name: x for name, x in run.base.items() if name not in ("pos", "vel")} for run in log.runs)
    return replace(log, runs=tuple(replace(run, base=seen) for run, seen in zip(log.runs, base, strict=True)))


def walked_with(folder: Path, *hide: str) -> tuple[RobotLog, ReplayModel, Windows]:
    """Log of 2 s of walking of a robot with hidden effects, its replay model and its windows."""
    cfg = LogCfg(robot="mr_go", motions=(("walk", 2.0),), policy=DEFAULT_POLICY, seed=1, hide=hide)
    with contextlib.suppress(OSError):
        record(cfg, folder)
    log = load_log(folder)
    model = replay_model(Path("mr_go"), log)
    (group,) = cut_windows(model, log)
    return log, model, group


def rerun(model: ReplayModel, group: Windows, changes: ParameterBatch) -> dict[str, np.ndarray]:
    """Replay of all windows from their own starts."""
    start = np.zeros((group.count, len(nuisances(model))))
    return Replay(model, group).run(changes, np.arange(group.count), start)


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
    _, model, group = walked_with(tmp_path, "encoder_offset=FR_hip:0.04", "gyro_bias=0,0,0.3")
    bias = np.tile([0.0, 0.0, 0.3], (group.count, 1))
    wrong = []
    for size in (0.0, 0.04):
        offset = np.zeros((group.count, len(model.joints)))
        offset[:, model.joints.index("FR_hip")] = size
        found = rerun(model, group, ParameterBatch({"bias": bias, "offset": offset}))
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
    log, model, group = walked_with(tmp_path, hide)
    own = [p for p in parameters_of(model, log) if p.cause == cause][:1]
    assert own[0].is_nuisance == (cause == "ground_stiffness")
    assert own[0].absolute(size) == pytest.approx(1.0 / (1.0 + size))
    wrong = []
    for change in (0.0, size):
        found = rerun(model, group, ParameterBatch.of(own, np.full((group.count, 1), change), model))
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
    q = rerun(model, group, ParameterBatch({"shift": shift}))["q"][:, :, hips]
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
        speeds.append(rerun(model, high, ParameterBatch({"pull": pull}))["vel"][:, -1])
    gained = 10.0 / model.model.body_mass.sum() * group.t[0, -1]
    assert np.median(speeds[1] - speeds[0], axis=0) == pytest.approx([0.0, gained, 0.0], abs=0.1 * gained)


def test_a_torque_was_read_before_the_row_s_command_acts(tmp_path: Path) -> None:
    """Of a healthy arm whose targets step, replayed and logged torque agree at the very row of the step."""
    folder = arm_log(tmp_path, seconds=4.0)
    log = load_log(folder)
    model = replay_model(folder / "arm.xml", log)
    (group,) = cut_windows(model, log)
    count = group.count
    known = replace(group, measured=group.measured | {"tau": np.zeros_like(group.measured["q"])})
    found = rerun(model, known, ParameterBatch({}))
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
        about=np.zeros(2),
        base=read,
        windows=SimpleNamespace(),
    )
    error = 1.0 / np.sqrt(2.0 * read.size)
    assert _currents_alone([slopes], [read])["current"] == pytest.approx([0.004], rel=4.0 * error)
