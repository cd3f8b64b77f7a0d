"""Derivatives of replays: limbs that do not move each other share robots, and forms are of what moves a reading."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.robot_logs import slopes
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.replay_model import ReplayModel, replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.slopes import START_SPREAD, Slopes, completed, slopes_of
from mrwarp.robot_logs.window_replay import ParameterBatch
from mrwarp.robot_logs.windows import cut_windows

LIMBS = ("left", "right", "rear")


def _log(folder: Path, *, tied: bool) -> Path:
    """Three limbs of two joints on a held body, which swing; an equality may tie two of them together."""
    limbs = "".join(
        f'<body name="{limb} upper" pos="0 {0.2 * k} 0"><joint name="{limb} hip" axis="0 1 0" armature="0.01"/>'
        '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.5"/>'
        f'<body name="{limb} lower" pos="0 0 -0.2"><joint name="{limb} knee" axis="0 1 0" armature="0.01"/>'
        '<geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.2" mass="0.3"/></body></body>'
        for k, limb in enumerate(LIMBS)
    )
    tie = '<equality><joint joint1="left hip" joint2="right hip"/></equality>' if tied else ""
    folder.mkdir()
    (folder / "robot.xml").write_text(f"<mujoco><worldbody>{limbs}</worldbody>{tie}</mujoco>")
    (folder / "log.json").write_text(json.dumps({"robot": "robot.xml", "base": "fixed", "kp": 10, "kd": 0.3}))
    t, joints = 0.005 * np.arange(260), [f"{limb} {part}" for limb in LIMBS for part in ("hip", "knee")]
    q = 0.4 * np.sin(6.0 * t[:, None] + np.arange(6)) + np.random.default_rng(0).normal(0.0, 1e-3, (len(t), 6))
    names = ["t", *(f"q.{j}" for j in joints), *(f"q_des.{j}" for j in joints)]
    np.savetxt(folder / "run.csv", np.column_stack([t, q, q]), delimiter=",", header=",".join(names), comments="")
    return folder


def _derivatives(path: Path, monkeypatch: pytest.MonkeyPatch, *, separate: bool = False) -> tuple[Slopes, int]:
    """Of all numbers, about a robot that is a little off; and how many robots were replayed."""
    if separate:
        monkeypatch.setattr(ReplayModel, "limbs", {})
    log = load_log(path)
    model = replay_model(path / "robot.xml", log)
    parameters, (windows, *_) = parameters_of(model, log), cut_windows(model, log)
    robots, of = [0], ParameterBatch.of
    count = staticmethod(lambda p, x, m: robots.append(robots.pop() + len(x)) or of(p, x, m))
    with monkeypatch.context() as patched:
        patched.setattr(slopes.ParameterBatch, "of", count)
        found = slopes_of(model, windows, parameters, np.array([0.01 * p.fault for p in parameters]), lambda _: None)
    return found, robots[0] // windows.count


def test_limbs_share_replays(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A third of the robots give the same derivatives; limbs that a constraint ties together share none.

    The same bits, for no sum of the dynamics goes across limbs of a held body.
    """
    path = _log(tmp_path / "separate", tied=False)
    (ours, few), (alone, many) = _derivatives(path, monkeypatch), _derivatives(path, monkeypatch, separate=True)
    assert few < 0.4 * many
    np.testing.assert_array_equal(ours.j, alone.j)
    np.testing.assert_array_equal(ours.z, alone.z)
    monkeypatch.undo()
    assert _derivatives(_log(tmp_path / "tied", tied=True), monkeypatch)[1] == many


def test_forms_are_those_of_all_readings_at_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Readings that other numbers move are multiplied by themselves; their sum is the whole.

    To the rounding of sums over all readings, times the condition of what is solved for the start.
    """
    found, _ = _derivatives(_log(tmp_path / "log", tied=False), monkeypatch)
    assert len(found.blocks) >= len(LIMBS)
    rng = np.random.default_rng(1)
    rows = rng.normal(0.0, 1e-3, (len(found.j), found.j.shape[-1]))
    sigma = {name: rng.uniform(1e-3, 2e-3, columns) for name, (_, columns) in found.layout.items()}
    a, b, c = found.reduced(rows, sigma)
    for w, r in enumerate(rows / found.scale(sigma)):
        j, z = found.j[w] / found.scale(sigma), found.z[w] / found.scale(sigma)
        start = z @ z.T + np.eye(len(z)) / START_SPREAD**2
        free = np.eye(len(r)) - z.T @ np.linalg.solve(start, z)
        rounding = len(r) * np.linalg.cond(start) * np.finfo(float).eps
        size = np.linalg.norm(j, axis=1).max(), np.linalg.norm(r)
        np.testing.assert_allclose(a[w], j @ free @ j.T, rtol=0, atol=rounding * size[0] ** 2)
        np.testing.assert_allclose(b[w], j @ free @ r, rtol=0, atol=rounding * size[0] * size[1])
        assert c[w] == pytest.approx(r @ free @ r, abs=rounding * size[1] ** 2)


def test_windows_that_are_known_are_not_replayed_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Their derivatives come with those of the rest, in the log's order; with all of them known nothing is replayed."""
    log = load_log(_log(tmp_path / "log", tied=False))
    model = replay_model(tmp_path / "log" / "robot.xml", log)
    parameters, (windows, *_) = parameters_of(model, log), cut_windows(model, log)
    theta, asked = np.array([0.01 * p.fault for p in parameters]), []
    taken = slopes.slopes_of

    def noted(model, windows, *args) -> Slopes:  # noqa: ANN001, ANN002
        asked.append(windows.start.tolist())
        return taken(model, windows, *args)

    monkeypatch.setattr(slopes, "slopes_of", noted)
    some = taken(model, windows.some(np.array([1])), parameters, theta, lambda _: None)
    whole = taken(model, windows, parameters, theta, lambda _: None)
    found = completed([some], model, windows, parameters, theta, lambda _: None)
    assert windows.count > 1 and asked == [np.delete(windows.start, 1).tolist()]
    for name in ("j", "z", "base"):
        np.testing.assert_array_equal(getattr(found, name), getattr(whole, name))
    assert found.windows.h == whole.windows.h and found.windows.count == windows.count
    completed([whole], model, windows, parameters, theta, lambda _: None)
    assert len(asked) == 1
