"""Pushes from all directions: where they go, what is counted, and what is taken from a folder."""

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.resources import POLICIES
from mrwarp.trials.statistics import share
from paper.study import pushes
from paper.study.pushes import DIRECTIONS, Pusher, PushesCfg, directions, stance, summary

CFG = PushesCfg(policies=POLICIES / "study_rough", seeds=(0,), currents=(0.0, 1.5), trials=2, threads=1)


def cell(fell: np.ndarray, moved: np.ndarray) -> dict[str, Any]:
    """Content of an arm of a cell."""
    pairs = dict.fromkeys(("damps", "holds", "damping_work", "holding_work"), [0.0, 0.0])
    return {"fell": fell.astype(int).tolist(), "moved": np.where(fell, np.nan, moved).tolist(), **pairs}


def test_pushes_fill_the_circle() -> None:
    """Evenly, each sector about its own direction."""
    angle = directions(5)
    steps = np.diff(angle.ravel())
    assert steps == pytest.approx(np.full(steps.shape, 2.0 * np.pi / 60))
    assert angle.mean(axis=1) == pytest.approx(2.0 * np.pi * np.arange(12) / 12)


def test_intervals() -> None:
    """Wilson's for shares, as Wilson (1927) has it; the change is paired and its interval is over robots."""
    found = share(5, 20)
    z, p, n = 1.959964, 0.25, 20
    middle, half = (
        (p + z * z / 2 / n) / (1 + z * z / n),
        z / (1 + z * z / n) * np.sqrt(p * (1 - p) / n + z**2 / 4 / n**2),
    )
    assert (found["low"], found["high"]) == pytest.approx((middle - half, middle + half), abs=0.5e-6)  # z's digits
    none = np.zeros((DIRECTIONS, 4), dtype=bool)
    some = none.copy()
    some[3, :] = True  # to the left every robot falls
    rows = summary(["0 A", "1.5 A"], [{"0 A": cell(some, 0 * some + 0.5), "1.5 A": cell(none, 0 * none + 0.4)}])
    row = rows["1.5 A"]
    assert row["fell_change"] == pytest.approx({"mean": -1 / 12, "half_width": 0.0})
    assert row["moved_change"] == pytest.approx({"mean": -0.1, "half_width": 0.0, "pushes": 44})
    assert rows["0 A"]["aside"]["share"] == pytest.approx(4 / 24) and rows["0 A"]["ahead"]["share"] == 0.0
    assert rows["0 A"]["by_direction"][3]["share"] == 1.0 and np.isnan(rows["0 A"]["moved"][3])


def test_what_is_in_the_folder_is_not_done_again(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A second run pushes nobody; another number of trials, a seed without a policy or one current is refused."""
    pushed = []
    arm = cell(np.zeros((DIRECTIONS, 1), dtype=bool), np.full((DIRECTIONS, 1), 0.3))

    def push(self: Pusher, force: float) -> dict[str, Any]:
        pushed.append((self.ground, force))
        return dict.fromkeys(pushes.arms(self.cfg), arm)

    monkeypatch.setattr(Pusher, "push", push)
    line = ["study", "pushes", "--seeds", "0", "--strengths", "50", "--trials", "1", "--out", str(tmp_path)]
    assert main(line) == 0 and [ground for ground, _ in pushed] == list(pushes.GROUNDS)
    found = json.loads((tmp_path / "result.json").read_text())
    assert found["rows"]["rough"]["50"]["1.5 A"]["fell"]["share"] == 0.0 and (tmp_path / "pushes.png").is_file()
    assert main(line) == 0 and len(pushed) == 3
    for more in (["--trials", "2"], ["--seeds", "99"], ["--currents", "1"], ["--strengths", "50", "50"]):
        assert main([*line, *more]) == 2 and len(pushed) == 3


@pytest.mark.slow
def test_a_held_stance_bears_what_a_soft_one_does_not() -> None:
    """Pushed to a side with 60 N, a standing robot falls without current and stands with 1.5 A; holding does it."""
    found = Pusher(replace(CFG, seconds=1.5), "standing", 0, stance).push(60.0)
    fell = {name: np.mean(arm["fell"]) for name, arm in found.items()}
    assert fell["0 A"] > 0.2 and fell["1.5 A"] == fell["1.5 A, holding only"] == 0.0
    assert np.array(found["0 A"]["fell"])[[2, 3, 4, 8, 9, 10]].sum() == np.sum(found["0 A"]["fell"])
    assert found["0 A"]["holds"] == pytest.approx([0.0, 0.0]) and found["1.5 A"]["holds"][0] > 0.5
    assert found["1.5 A, damping only"]["holds"] == pytest.approx([0.0, 0.0])
