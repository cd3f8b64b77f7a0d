"""Where holding ends: classes of margin, fastest speed, the pulse that demagnetises, and what a folder keeps."""

import json
import math
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from mrwarp.cli import main
from mrwarp.resources import POLICIES
from mrwarp.usd.robot import TROT_PHASE
from paper.study import limits, release
from paper.study.limits import LimitsCfg, gait_row, margin_rows, settings

CFG = LimitsCfg(policies=POLICIES / "energy", seeds=(0, 1), trials=2, threads=1)
NAMES = ("fell", "speed", "v_x_rmse", "power", "coil", "cot", "hold", "clock", "slipped", "short", "full")


def made_up(count: int) -> dict[str, Any]:
    """Figures of so many settings and one policy."""
    return {name: [[0.0]] * count for name in NAMES}


def test_settings_are_the_same_for_every_policy() -> None:
    """Policies x settings x trials, as ``act`` and ``by_setting`` take them."""
    assert settings(CFG, (1.0, 2.0)).tolist() == [1.0, 1.0, 2.0, 2.0] * 2
    pairs = settings(CFG, [(1.0, 5.0), (2.0, 6.0)])
    assert pairs.shape == (8, 2) and pairs[4:6].tolist() == [[1.0, 5.0]] * 2
    found = limits.by_setting(CFG, {"x": np.array([1.0, 3.0, 5.0, 5.0, 2.0, 2.0, 8.0, 9.0])}, 2)
    assert found == {"x": [[2.0, 2.0], [5.0, 8.5]]}


def test_a_speed_is_held_when_all_slower_ones_are() -> None:
    """Nobody falls and the mean is 90 % of the command."""
    speeds = np.array(limits.SPEEDS)
    speed = np.stack([speeds, 0.95 * speeds, 0.95 * speeds], axis=1)
    speed[3, 0] *= 0.8  # too slow at 0.6 m/s, well again at 0.7
    fell = np.zeros_like(speed)
    fell[1, 2] = 0.5
    found = {**{n: np.zeros_like(speed) for n in NAMES}, "speed": speed, "fell": fell}
    steady = {"speed": np.stack([speeds] * 3, axis=1), "fell": np.zeros_like(fell)}
    rows = gait_row(found, {**found, **steady, "power": found["power"] - np.array([1.0, 2.0, 3.0])})
    assert rows["fastest"]["values"] == [0.5, limits.SPEEDS[-1], 0.3]
    assert rows["fastest_change"]["values"] == pytest.approx([0.5 - limits.SPEEDS[-1], 0.0, 0.3 - limits.SPEEDS[-1]])
    half = 4.303 / 3**0.5  # Student's t of two degrees of freedom, to half of its last digit
    assert rows["power_change"]["mean"] == 2.0
    assert rows["power_change"]["half_width"] == pytest.approx(half, rel=0.5e-3 / 4.303)


def test_stances_by_margin() -> None:
    """Fallen ones and those without current do not count."""
    found = {"margin": [0.5, 0.9, 1.1, 3.0, 3.0, 0.0], "drift": [0.1, 0.3, 0.01, 0.001, 9.0, 0.0],
             "slipped": [1, 1, 0, 0, 1, 0], "fell": [0, 0, 0, 0, 1, 0],
             "current": [0.2, 0.2, 0.3, 1.0, 1.0, 0.0]}  # fmt: skip
    rows = margin_rows(found)
    assert [(r["low"], r["stances"], r["slipped"]["share"], r["most"]) for r in rows] == [
        (0.0, 2, 1.0, 0.3),
        (1.0, 1, 0.0, 0.01),
        (2.0, 1, 0.0, 0.001),
    ]
    assert rows[0]["drift"] == pytest.approx(0.2)


@pytest.mark.parametrize("lead", [0.0, 0.05])
def test_a_pulse_leaves_a_core_without_field(lead: float) -> None:
    """The coil's current swings to minus the play's half width and no further, which ends the field."""
    width, dt, lag = 0.1, 0.005, release.LAG
    zeros = torch.zeros(1, 4)
    env: Any = SimpleNamespace(
        actuator=SimpleNamespace(coil=zeros.clone()),
        view=lambda x: x,
        sim=SimpleNamespace(dt=dt),
        arrays=SimpleNamespace(current_command=zeros.clone()),
        robot=SimpleNamespace(before_hooks=[]),
        cfg=SimpleNamespace(decimation=4, gait_frequency=1.5),
        phase=torch.tensor([0.5 - 0.04 * 1.5]),
        f_foot=torch.full((1, 4), 50.0),
        contact_force=5.0,
        current_e=torch.tensor([0.5]),
    )
    one = torch.ones(1)
    release.Releaser(env, lead * one, one > 0.0, width * one)
    leg = TROT_PHASE.index(0.0)
    coil, field, commands = 0.37, 0.37, []
    if lead == 0.0:
        env.robot.before_hooks[0]()
        assert env.arrays.current_command[0, leg] == 0.5  # loaded: as the gates have it
        env.f_foot[:] = 0.0
    else:
        env.phase[:] = 0.3
        env.robot.before_hooks[0]()
        env.phase[:] = 0.5 - 0.04 * 1.5  # still loaded, but its release is due
    for _ in range(release.PULSE_STEPS + 3):
        env.actuator.coil[0, leg] = coil
        env.robot.before_hooks[0]()
        command = float(env.arrays.current_command[0, leg])
        mean = command + (coil - command) * lag / dt * (1.0 - math.exp(-dt / lag))
        coil = command + (coil - command) * math.exp(-dt / lag)
        field = min(max(field, mean - width), mean + width)  # Prandtl's play, mrwarp.effects.remanence
        commands.append(command)
    assert commands[0] == commands[1] < 0.0 and commands[2:] == [0.0] * 3
    rounding = 4.0 * torch.finfo(torch.float32).eps * max(map(abs, commands))
    assert field == pytest.approx(0.0, abs=rounding)


def test_what_is_in_the_folder_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Neither study measures twice; other choices and a seed without a policy are refused."""
    done = []

    def walked(count: int) -> Any:
        return lambda *_: done.append(count) or made_up(count)

    standing = {
        "slope": [0.0],
        "lateral": [0.0],
        "current": [1.0],
        "margin": [3.0],
        "drift": [1e-3],
        "sank": [0.0],
        "slipped": [0],
        "fell": [0],
        "held": [1.0],
    }
    monkeypatch.setattr(limits, "gait", walked(len(limits.SPEEDS)))
    monkeypatch.setattr(limits, "payload", walked(len(limits.PAYLOADS)))
    monkeypatch.setattr(limits, "gain_and_lag", walked(len(limits.GAINS) * len(limits.LAGS)))
    monkeypatch.setattr(limits, "age", walked(2 * len(limits.LOSSES)))
    monkeypatch.setattr(limits, "stance", lambda *_: done.append(1) or standing)
    cases = len(release.WIDTHS) * len(release.RELEASES)
    monkeypatch.setattr(
        release, "measure", lambda *_: done.append(cases) or {**made_up(cases), "drag": [[0.1]] * cases}
    )
    trained: list[float] = []

    def settled(env: Any, seed: int, updates: int, _: object, begin: Path, folder: Path, __: str) -> Path:
        trained.append(env.gait_frequency)
        assert updates in (7, 8) and env.commands.v_x == limits.LEARNED and folder.parent.name == "trained"
        return begin

    monkeypatch.setattr(limits, "settled", settled)
    for study, jobs in (("limits", 8), ("release", 1)):
        line = ["study", study, "--seeds", "0", "--out", str(tmp_path / study)]
        assert main(line) == 0 and len(done) == jobs
        assert main(line) == 0 and len(done) == jobs
        assert (
            json.loads((tmp_path / study / "result.json").read_text()) and (tmp_path / study / f"{study}.png").is_file()
        )
        assert main([*line, "--trials", "7"]) == 2 and main([*line, "--seeds", "99"]) == 2 and len(done) == jobs
        done.clear()
    line = ["study", "limits", "--seeds", "0", "--train", "7", "--out", str(tmp_path / "limits")]
    assert main(line) == 0 and len(done) == len(limits.GAITS) and trained == list(limits.GAITS)
    found = json.loads((tmp_path / "limits" / "result.json").read_text())
    assert list(found["gait_trained"]) == ["1.5", "2", "2.5"] and found["took"]["measuring"] > 0.0
    assert main([*line[:-3], "8", *line[-2:]]) == 2, "trained for 7 updates"


@pytest.mark.slow
def test_a_stance_slips_where_the_yield_is_below_the_need(monkeypatch: pytest.MonkeyPatch) -> None:
    """At 0.2 A the knees slide, at 1.5 A they do not; a slope and a load to the side take some of the margin."""
    for name, values in (("SLOPES", (0.0, 0.3)), ("LATERAL", (0.0, 20.0)), ("STAND_CURRENTS", (0.0, 0.2, 1.5))):
        monkeypatch.setattr(limits, name, values)
    found = {
        name: np.asarray(x) for name, x in limits.stance(LimitsCfg(policies=CFG.policies, trials=1), "flat").items()
    }
    weak, strong = found["current"] == 0.2, found["current"] == 1.5
    assert (found["margin"][weak] < 1.0).all() and found["slipped"][weak].all()
    assert (found["margin"][strong] > 1.2).all() and not found["slipped"][strong].any()
    margin = found["margin"][strong].reshape(2, 2, 2).mean(axis=2)
    assert margin[0, 0] > margin[0, 1] and margin[0, 0] > margin[1, 0]


@pytest.mark.slow
def test_a_field_drags_in_swing_until_a_pulse_ends_it(monkeypatch: pytest.MonkeyPatch) -> None:
    """The device's torque in swing grows with what stays in the core; with a pulse it is what it was."""
    monkeypatch.setattr(release, "WIDTHS", (0.0, 0.2))
    cfg = LimitsCfg(policies=CFG.policies, seeds=(0,), trials=1, seconds=2.0, threads=1)
    (none, *_), (field, pulse, *_) = np.reshape(release.measure(cfg, limits.ElectricalCfg())["drag"], (2, -1))
    assert field > none + 0.05 and pulse < none + 0.02
