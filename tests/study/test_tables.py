"""Tables 2 and 3: statistics against closed forms, rows from policy files, and what a missing policy gives."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from mrwarp.rl.policy import DEFAULT_POLICY, PolicyError
from mrwarp.study import cli
from mrwarp.study.plan import CONVENTIONAL, MODELS, policy_file
from mrwarp.study.tables import EvaluationCfg, change, table2, table3, welch

pytestmark = pytest.mark.filterwarnings("ignore:Precision loss")  # equal seeds have no spread


@pytest.fixture
def cfg(tmp_path: Path) -> EvaluationCfg:
    """Two seeds of every training, all of them the shipped policy; rollouts of 0.3 s on the Bouc-Wen plant."""
    for plant in (CONVENTIONAL, *MODELS):
        for seed in (0, 1):
            shutil.copyfile(DEFAULT_POLICY, policy_file(tmp_path, plant, seed))
    return EvaluationCfg(folder=tmp_path, seeds=(0, 1), rollouts=2, plant="bouc_wen", warmup=0.0, seconds=0.3)


def test_welch_interval_and_p_value_are_the_closed_form() -> None:
    """Difference of two means of three, by hand: standard error, Welch-Satterthwaite degrees of freedom, t quantile."""
    a, b = np.array([1.0, 2.0, 4.0]), np.array([0.5, 0.6, 0.4])
    va, vb = a.var(ddof=1) / 3, b.var(ddof=1) / 3
    dof = (va + vb) ** 2 / (va**2 / 2 + vb**2 / 2)
    delta, error = a.mean() - b.mean(), np.sqrt(va + vb)
    (low, high), p = welch(a, b)
    half = stats.t.ppf(0.975, dof) * error
    assert (low, high) == pytest.approx((delta - half, delta + half))
    assert p == pytest.approx(2.0 * stats.t.sf(delta / error, dof))


def test_change_compares_absolute_means_of_a_bias() -> None:
    """-0.2 against +0.1 m/s is a reduction of one half; the interval is that of the signed difference, +0.3."""
    found = change(np.array([-0.21, -0.19]), np.array([0.09, 0.11]), absolute=True)
    assert (found.first, found.second, found.reduction) == pytest.approx((0.2, 0.1, 0.5))
    assert found.interval[0] < 0.3 < found.interval[1]
    opposite = change(np.array([-0.2, -0.2]), np.array([-0.1, 0.1]), absolute=True)
    assert (opposite.reduction, opposite.by_seed) == pytest.approx((1.0, 0.5))


def test_table2_of_equal_policies_finds_no_difference_and_currents_matter(cfg: EvaluationCfg) -> None:
    """A = C and B = D to the bit when both trainings are one policy; SAL on differs from off."""
    table = table2(cfg)
    assert list(table.rows) == ["A", "B", "C", "D"]
    assert [row.current for row in table.rows.values()] == [0.0, 1.5, 0.0, 1.5]
    for first, second in (("A", "C"), ("B", "D")):
        for metric, values in table.rows[first].rollouts.items():
            assert values.shape == (2, 2)
            np.testing.assert_array_equal(values, table.rows[second].rollouts[metric])
    assert table.rmse["on"].reduction == pytest.approx(0.0, abs=1e-12)
    row = table.rows["B"]
    ripple = np.sqrt(row.rollouts["v_x_rmse"] ** 2 - row.rollouts["v_x_bias"] ** 2)
    assert row.ripple == pytest.approx(float(ripple.mean()))
    assert f"by {1.0 - row.ripple / float(row.seeds['v_x_rmse'].mean()):.0%}" in table.limits()["on"]
    np.testing.assert_allclose(row.seeds["v_x_rmse"], row.rollouts["v_x_rmse"].mean(axis=1))
    assert not np.array_equal(row.rollouts["v_x_rmse"], table.rows["A"].rollouts["v_x_rmse"])


def test_rough_ground_is_walked_on(cfg: EvaluationCfg) -> None:
    """Six rollouts stand on six tiles: their figures differ from those of flat ground, and from each other."""
    flat, rough = (table2(replace(cfg, rollouts=6, terrain=ground)).rows["A"] for ground in ("flat", "rough"))
    changed = ~np.isclose(flat.rollouts["v_x_rmse"], rough.rollouts["v_x_rmse"], rtol=1e-3)
    assert changed.sum() >= 2 and rough.fell == 0


def test_table3_ranks_models_and_corrects_for_six_pairs(cfg: EvaluationCfg) -> None:
    """Equal policies: no difference between the two of any of the six pairs of each metric."""
    table = table3(cfg)
    assert tuple(table.rows) == MODELS
    assert set(table.ranking) == {"v_x_rmse", "v_x_bias", "height_rmse", "tilt_rms", "yaw_rate_rmse"}
    assert all(sorted(order) == sorted(MODELS) for order in table.ranking.values())
    assert len(table.pairs) == 6 * len(table.ranking)
    assert all(pair.difference == 0.0 for pair in table.pairs)


def test_missing_policy_is_named(cfg: EvaluationCfg) -> None:
    """The file that is not there."""
    with pytest.raises(PolicyError, match=r"conventional_seed7\.onnx: no such policy"):
        table2(replace(cfg, seeds=(7,)))


def test_command_writes_figures_and_refuses_a_folder_without_policies(
    cfg: EvaluationCfg, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 2, one line and nothing written without policies; else a table, and 1: equal policies gain nothing."""
    out = tmp_path / "out"
    assert cli.main(["table2", "--out", str(out), "--policies", str(tmp_path / "none")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "conventional_seed0.onnx: no such policy" in error
    assert not out.exists()

    monkeypatch.setattr("mrwarp.study.tables.EvaluationCfg", lambda **_: cfg)
    assert cli.main(["table2", "--out", str(out), "--policies", str(tmp_path), "--seeds", "0", "1"]) == 1
    assert (out / "result.json").is_file()
    assert "SAL on: actuator-aware training lowers v_x RMSE by" in capsys.readouterr().out
