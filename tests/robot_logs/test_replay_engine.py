"""MuJoCo's own batch and MuJoCo-Warp replay one log identically, on the CPU and on a GPU."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.enums import BackendKind
from mrwarp.rl.policy import DEFAULT_POLICY
from mrwarp.robot_logs import window_replay
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import RobotLog, load_log
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import Windows, cut_windows


@pytest.fixture(scope="module")
def squat(tmp_path_factory: pytest.TempPathFactory) -> RobotLog:
    """A log of squats, whose devices hold."""
    folder = tmp_path_factory.mktemp("squat")
    record(LogCfg(robot="mr_go", motions=(("squat", 2.5),), policy=DEFAULT_POLICY, seed=3), folder)
    return load_log(folder)


def replayed(model: ReplayModel, log: RobotLog, windows: Windows, leg: str = "", **engine) -> list[np.ndarray]:
    """Readings of the described robot and of one with each parameter off by its step, a channel each, (E, S, C).

    With a leg the parameters of the other legs are left out.
    """
    parameters, others = parameters_of(model, log), {"FL", "FR", "RL", "RR"} - {leg} if leg else set()
    steps = np.diag([p.step for p in parameters])[[p.where[:2] not in others for p in parameters]]
    theta = np.concatenate([np.zeros((1, len(parameters))), steps])
    rng = np.random.default_rng(5)
    window = rng.integers(0, windows.count, len(theta))
    start = 0.3 * rng.normal(size=(len(theta), 1)) * nuisances(model)
    found = Replay(model, windows, **engine).run(ParameterBatch.of(parameters, theta, model), window, start)
    return list(found.values())


def furthest(a: list[np.ndarray], b: list[np.ndarray]) -> float:
    """Largest root mean square of the difference of a robot's readings, in units of its channel's."""
    return max(
        float((np.sqrt(np.nanmean((x - y) ** 2, axis=(1, 2))) / np.sqrt(np.nanmean(x**2))).max())
        for x, y in zip(a, b, strict=True)
    )


def test_mujoco_warp_replays_as_mujoco(squat: RobotLog, monkeypatch: pytest.MonkeyPatch) -> None:
    """The drives', the devices' and the robot's parameters have the same effect; float32 is what differs."""
    monkeypatch.setattr(window_replay, "GPU_LEAST", 1)
    model = replay_model(Path("mr_go"), squat)
    (windows,) = cut_windows(model, squat)
    coarse = windows.coarse(5)
    rows = (replayed(model, squat, coarse, "FR", kind=kind) for kind in (BackendKind.MJBATCH, BackendKind.MJWARP))
    assert furthest(*rows) < 1e-3


def test_an_engine_is_used_again_for_windows_of_the_same_step(squat: RobotLog) -> None:
    """Its commands are those of the windows at hand, and links are as long as described again."""
    model = replay_model(Path("mr_go"), squat)
    (windows,) = cut_windows(model, squat)
    coarse = windows.coarse(5)
    first = replayed(model, squat, coarse, "FR")
    engines = dict(model.engines)
    other = replace(coarse, feed=coarse.feed + 2.0)
    assert furthest(first, replayed(model, squat, other, "FR")) > 0.1
    assert furthest(first, replayed(model, squat, coarse, "FR")) == 0.0
    assert model.engines == engines


@pytest.mark.gpu
def test_a_gpu_replays_as_a_cpu(squat: RobotLog) -> None:
    """At the step of the derivatives and at the fine one."""
    cpu, gpu = (replay_model(Path("mr_go"), squat, device) for device in ("cpu", "cuda:0"))
    (windows,) = cut_windows(cpu, squat)
    for own in (windows.coarse(5), windows):
        far = furthest(*(replayed(model, squat, own) for model in (cpu, gpu)))
        assert far < 1e-3
