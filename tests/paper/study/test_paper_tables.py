"""Tables 2 and 3: statistics against closed forms, rows from policy files, and what a missing policy gives."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy import stats

from mrwarp.cli import main
from mrwarp.resources import policy_file
from mrwarp.rl.policy import DEFAULT_POLICY, PolicyError
from paper.study import paper_tables
from paper.study.paper_tables import PolicyRow, Table3, change, holm, table2, table3, welch
from paper.study.plan import CONVENTIONAL, MODELS
from paper.study.rollouts import METRICS, EvaluationCfg

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


def biased(monkeypatch: pytest.MonkeyPatch, bias: dict[str, list[float]]) -> Table3:
    """Table 3 of seeds with these biases by model; all other figures are 1 to 3."""
    rows = {}
    for model, values in bias.items():
        seeds = {m: np.array(values) if m == "v_x_bias" else np.arange(1.0, 1.0 + len(values)) for m in METRICS}
        rollouts = {metric: averages[:, None] for metric, averages in seeds.items()}
        rows[model] = PolicyRow(plant=model, current=1.5, seeds=seeds, rollouts=rollouts, fell=0)
    monkeypatch.setattr(
        "paper.study.paper_tables.evaluate", lambda cfg, cells, report: [rows[model] for model, _ in cells]
    )
    return table3(models=tuple(bias))


def test_table3_ranks_a_bias_by_what_it_tests(monkeypatch: pytest.MonkeyPatch) -> None:
    """Seeds of +0.040, -0.041 and +0.001 cancel in the mean; without sign they are 0.027 against 0.010."""
    first, second = [0.040, -0.041, 0.001], [0.010, 0.011, 0.009]
    table = biased(monkeypatch, {"mlp": first, "lstm": second})
    assert table.ranking["v_x_bias"] == ("lstm", "mlp")
    (pair,) = (pair for pair in table.pairs if pair.metric == "v_x_bias")
    assert (pair.better, pair.worse) == ("lstm", "mlp")
    assert pair.difference == pytest.approx(0.082 / 3 - 0.010)
    assert pair.p == pytest.approx(welch(np.abs(first), np.array(second))[1])


def test_a_model_without_figures_is_ranked_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """A seed whose rollouts fell before the measurement."""
    table = biased(monkeypatch, {"mlp": [float("nan"), 0.0], "lstm": [0.2, 0.3], "bouc_wen": [0.1, 0.2]})
    assert table.ranking["v_x_bias"] == ("bouc_wen", "lstm", "mlp")


def test_one_seed_is_no_test(monkeypatch: pytest.MonkeyPatch) -> None:
    """Its p-values are NaN, not 1, and the printed table says so; Holm's correction lets a NaN pass."""
    table = biased(monkeypatch, {"mlp": [0.2], "lstm": [-0.1], "pg_rlstm": [0.0]})
    assert all(np.isnan(pair.p) for pair in table.pairs)
    lines = paper_tables.table3_lines(table)
    assert lines[-4] == "v_x_bias: pg_rlstm < lstm < mlp; beyond chance (p < 0.05): not tested"
    assert holm([0.02, float("nan"), 0.01, 0.4]) == pytest.approx([0.06, float("nan"), 0.04, 0.8], nan_ok=True)
    assert holm([]) == []


def test_change_compares_absolute_means_of_a_bias() -> None:
    """-0.2 against +0.1 m/s is a reduction of one half; interval and p-value are those of the difference, -0.1."""
    found = change(np.array([-0.21, -0.19]), np.array([0.09, 0.11]), absolute=True)
    assert (found.first, found.second, found.reduction) == pytest.approx((0.2, 0.1, 0.5))
    assert (sum(found.interval) / 2.0, found.p) == pytest.approx(
        (-0.1, welch(np.array([0.21, 0.19]), np.array([0.09, 0.11]))[1])
    )
    mirrored = change(np.array([-0.21, -0.19]), np.array([0.21, 0.19]), absolute=True)
    assert (mirrored.reduction, mirrored.p) == pytest.approx((0.0, 1.0))
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


def test_a_seed_counts_once() -> None:
    """Two of one training would be two equal values, and p = 0."""
    with pytest.raises(ValueError, match=r"seeds = \(0, 0\): name each training seed once"):
        EvaluationCfg(seeds=(0, 0))


def test_missing_policy_is_named(cfg: EvaluationCfg) -> None:
    """The file that is not there."""
    with pytest.raises(PolicyError, match=r"conventional_seed7\.onnx: no such policy"):
        table2(replace(cfg, seeds=(7,)))


def test_command_writes_figures_and_refuses_a_folder_without_policies(
    cfg: EvaluationCfg, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Exit code 2, one line and nothing written without policies; else a table, and 1: equal policies gain nothing."""
    out = tmp_path / "out"
    assert main(["study", "table2", "--out", str(out), "--policies", str(tmp_path / "none")]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and "none: no such file or folder" in error
    assert not out.exists()

    monkeypatch.setattr("paper.study.paper_tables.EvaluationCfg", lambda **_: cfg)
    assert main(["study", "table2", "--out", str(out), "--policies", str(tmp_path), "--seeds", "0", "1"]) == 1
    assert (out / "result.json").is_file()
    assert "SAL on: actuator-aware training lowers v_x RMSE by" in capsys.readouterr().out
