"""Causes: every step changes the plant in one thing, and the rows are those of the tables."""

import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.resources import policy_file
from mrwarp.rl.policy import DEFAULT_POLICY
from paper.study.paper_tables import STEPS, _plant, causes, evaluate
from paper.study.plan import CONVENTIONAL
from paper.study.rollouts import EvaluationCfg


def test_every_step_changes_one_thing() -> None:
    """Robot, then devices, then current with one branch or both."""
    cfgs = {step: _plant(step, EvaluationCfg()) for step in STEPS}
    assert [cfg.robot for cfg, _ in cfgs.values()] == ["go1"] + ["mr_go"] * 5
    assert [cfg.actuator for cfg, _ in cfgs.values()] == ["none"] * 2 + ["bouc_wen"] * 4
    assert [current for _, current in cfgs.values()] == [0.0, 0.0, 0.0, 1.5, 1.5, 1.5]
    branches = [(cfg.damping, cfg.holding) for cfg, _ in list(cfgs.values())[2:]]
    assert branches == [(True, True), (True, False), (False, True), (True, True)]


def test_the_result_names_the_device(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The steps are Bouc-Wen devices, regardless of the other tables' devices."""
    monkeypatch.setattr("paper.study.paper_tables.causes", lambda *_: {})
    assert main(["study", "causes", "--out", str(tmp_path)]) == 0
    assert json.loads((tmp_path / "result.json").read_text())["evaluation"]["plant"] == "bouc_wen"


@pytest.mark.slow
def test_first_and_last_plant_of_mr_go_are_those_of_table_2(tmp_path: Path) -> None:
    """Devices at 0 A and at 1.5 A with both branches: the figures of ``evaluate``.

    A figure is a mean over 15 control steps in 32 bits: in another order of the sum it is off by 15 roundings of 6e-8.
    """
    shutil.copyfile(DEFAULT_POLICY, policy_file(tmp_path, CONVENTIONAL, 0))
    cfg = EvaluationCfg(folder=tmp_path, seeds=(0,), rollouts=2, plant="bouc_wen", warmup=0.0, seconds=0.3)
    rows = causes(cfg, [CONVENTIONAL])[CONVENTIONAL]
    assert list(rows) == list(STEPS)
    off, on = evaluate(cfg, [(CONVENTIONAL, 0.0), (CONVENTIONAL, 1.5)])
    for step, row in (("drag", off), ("both", on)):
        for metric, values in row.rollouts.items():
            np.testing.assert_allclose(rows[step].rollouts[metric], values, rtol=1e-6, err_msg=f"{step} {metric}")
    assert not np.array_equal(rows["go1"].rollouts["v_x_rmse"], off.rollouts["v_x_rmse"])
