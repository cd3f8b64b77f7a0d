"""Readings of a trunk's motion that contradict each other are named with a remedy that was tried; healthy ones stay."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mrwarp.robot_logs.channels.trunk_motion import one_trunk
from mrwarp.robot_logs.robot_log import LogError, LogRun, RobotLog, load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.windows import _attitude
from mrwarp.sysid.settings import Settings

DT, ROWS, YAW = 0.005, 2000, 1.2
Change = Callable[[np.ndarray, Rotation], np.ndarray]


def orientation(run: LogRun) -> Rotation:
    """Of the trunk along a recording."""
    return Rotation.from_quat(np.roll(run.base["quat"], -1, axis=1))


def swaying(yaw: float) -> RobotLog:
    """A trunk that sways, heads by ``yaw`` [rad] and wanders, by closed forms, with noise of usual sensors."""
    rng, t = np.random.default_rng(0), DT * np.arange(ROWS)

    def turned(t: np.ndarray) -> Rotation:
        lean = 0.15 * np.sin(3.1 * t) + 0.05, 0.12 * np.sin(4.3 * t + 1.0)
        return Rotation.from_euler("ZYX", np.stack([yaw + 0.2 * np.sin(0.7 * t), *lean], axis=1))

    turn, gyro = turned(t), (turned(t - 1e-5).inv() * turned(t + 1e-5)).as_rotvec() / 2e-5
    pos = np.stack([0.3 * np.sin(0.9 * t), 0.2 * np.sin(1.7 * t), 0.3 + 0.05 * np.sin(5.0 * t)], axis=1)
    vel = np.stack([0.27 * np.cos(0.9 * t), 0.34 * np.cos(1.7 * t), 0.25 * np.cos(5.0 * t)], axis=1)
    more = np.stack([-0.243 * np.sin(0.9 * t), -0.578 * np.sin(1.7 * t), 9.80665 - 1.25 * np.sin(5.0 * t)], axis=1)
    base = {
        "quat": np.roll(turn.as_quat(), 1, axis=1),
        "gyro": gyro + 0.004 * rng.standard_normal((ROWS, 3)) + [0.02, 0.0, -0.01],
        "acc": turn.inv().apply(more) + 0.05 * rng.standard_normal((ROWS, 3)),
        "pos": pos + 5e-4 * rng.standard_normal((ROWS, 3)),
        "vel": vel + 5e-3 * rng.standard_normal((ROWS, 3)),
    }
    run = LogRun(id="sway", t=t, joint={"q": np.zeros((ROWS, 1)), "q_des": np.zeros((ROWS, 1))}, base=base)
    gains = np.ones(1)
    return RobotLog(
        path=Path("log"), robot="", base="free", joints=("j",), kp=gains, kd=gains, tau_is="none", runs=(run,)
    )


@pytest.fixture(scope="module")
def healthy() -> RobotLog:
    """A trunk that heads away from north."""
    return swaying(YAW)


def test_a_trunk_without_orientation_is_level_with_a_note(healthy: RobotLog) -> None:
    """A robot that leans would be another one in silence."""
    (run,) = healthy.runs
    blind = replace(healthy, runs=(replace(run, base={"gyro": run.base["gyro"]}),))
    assert one_trunk(blind, Settings()).notes[-1].startswith("no quat in sway: the trunk is taken as level there")
    assert not any("level" in note for note in one_trunk(healthy, Settings()).notes)


def changed(log: RobotLog, channel: str, change: Change) -> RobotLog:
    """The log with another reading of a channel, (N, C), by the orientation."""
    (run,) = log.runs
    return replace(log, runs=(replace(run, base={**run.base, channel: change(run.base[channel], orientation(run))}),))


def later(rows: int) -> Change:
    """Readings that come some rows late."""
    return lambda x, _: np.concatenate([np.repeat(x[:1], rows, axis=0), x[:-rows]])


def test_a_healthy_trunk_is_kept(healthy: RobotLog) -> None:
    """As it is, and with a mounting off by 3°, a row's lateness and a scale of 2 %; no angular velocity is lost."""
    assert one_trunk(healthy, Settings()) is healthy
    for change in (later(1), lambda x, _: 1.02 * x, lambda x, _: Rotation.from_rotvec([0.03, 0.04, 0.0]).apply(x)):
        fair = changed(healthy, "gyro", change)
        assert one_trunk(fair, Settings()) is fair
    (run,) = healthy.runs
    without = replace(run, base={"quat": run.base["quat"]})
    np.testing.assert_allclose(_attitude(without)[1][5:-5], run.base["gyro"][5:-5], rtol=0, atol=0.05)


@pytest.mark.parametrize(
    ("channel", "change", "said"),
    [
        ("gyro", lambda x, turn: turn.apply(x), "is in the world's axes"),
        ("vel", lambda x, turn: turn.inv().apply(x), "is in the trunk's axes"),
    ],
)
def test_axes_that_are_nearly_the_same_are_distinguished(channel: str, change: Change, said: str) -> None:
    """A trunk that heads north differs from the world by its leaning alone, a mounted unit by what does not change."""
    log = swaying(0.0)
    assert one_trunk(log, Settings()) is log
    for fair in (later(1), lambda x, _: 1.02 * x, lambda x, _: Rotation.from_rotvec([0.03, 0.06, 0.0]).apply(x)):
        own = changed(log, "gyro", fair)
        assert one_trunk(own, Settings()) is own
    (note,) = one_trunk(changed(log, channel, change), Settings()).notes
    assert note.startswith(f"{channel} {said}"), note


@pytest.mark.parametrize(
    ("channel", "change", "said"),
    [
        ("gyro", lambda x, _: np.degrees(x), '"units": {"gyro": "deg/s"}'),
        ("gyro", lambda x, _: -x, "x is -x, y is -y, z is -z"),
        ("gyro", lambda x, _: x * [1.0, 1.0, -1.0], "of gyro z is -z"),
        ("gyro", lambda x, _: x[:, [1, 0, 2]] * [1.0, -1.0, 1.0], "of gyro x is y, y is -x"),
        ("gyro", lambda x, turn: turn.apply(x), "gyro is in the world's axes"),
        (
            "gyro",
            lambda x, _: Rotation.from_rotvec([0.0, 0.0, 0.5]).apply(x),
            "by 28° about (0.00, 0.00, -1.00)",
        ),
        ("gyro", lambda x, _: np.random.default_rng(1).normal(size=x.shape), "no other axes"),
        ("gyro", later(5), "comes 25 ms after the change of quat"),
        ("vel", lambda x, turn: turn.inv().apply(x), "vel is in the trunk's axes"),
        ("vel", lambda x, _: 1e3 * x, '"units": {"vel": "mm/s"}'),
        ("vel", later(8), "comes 40 ms after the change of pos"),
        ("acc", lambda x, _: -x, "its z is -z"),
        ("acc", lambda x, _: x[:, [2, 0, 1]], "its x is z"),
        ("acc", lambda x, turn: x - turn.inv().apply([0.0, 0.0, 9.80665]), "holds no gravity"),
    ],
)
def test_a_contradiction_is_named_with_what_explains_it(
    channel: str, change: Change, said: str, healthy: RobotLog
) -> None:
    """The channel is left out, but for the accelerometer's, and the others stay."""
    seen = one_trunk(changed(healthy, channel, change), Settings())
    (note,) = seen.notes
    assert note.startswith(channel) and said in note, note
    assert healthy.runs[0].base.keys() - seen.runs[0].base.keys() == ({channel} - {"acc"})


@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda x, _: np.roll(x, -1, axis=1), "quat is x, y, z, w (write w first)"),
        (lambda x, _: x * [1.0, -1.0, -1.0, -1.0], "quat turns the world's axes into the trunk's"),
        (
            lambda _, turn: np.roll((Rotation.from_rotvec([np.pi, 0.0, 0.0]) * turn).as_quat(), 1, axis=1),
            "upside down, by acc it is not",
        ),
        (lambda x, _: np.tile(x[:1], (len(x), 1)), "quat stands still while gyro moves"),
    ],
)
def test_an_orientation_that_is_another_is_refused(change: Change, said: str, healthy: RobotLog) -> None:
    """Gyroscope and accelerometer agree against it, and no replay could begin at it."""
    with pytest.raises(LogError) as refused:
        one_trunk(changed(healthy, "quat", change), Settings())
    assert said in str(refused.value)


def test_a_virtual_robot_s_sensors_agree(tmp_path: Path) -> None:
    """On its feet, with noise, lost rows and motion capture."""
    record(LogCfg(motions=(("lean", 2.0),), motion_capture=True, seed=2), tmp_path / "log")
    log = load_log(tmp_path / "log")
    assert one_trunk(log, Settings()) is log
