"""Figure 4: its verdicts, its picture, and that a stopped run goes on."""

from dataclasses import replace
from pathlib import Path

import pytest

from mrwarp import paper
from mrwarp.bench.virtual_bench import BenchCfg
from mrwarp.identify import learn
from mrwarp.nn.training import FitCfg
from paper.reproduce import fig4


@pytest.mark.usefixtures("drawn")
def test_figure4_judges_by_the_papers_claims_and_draws(tmp_path: Path) -> None:
    """The paper's values pass, and a good LSTM at one current fails the ranking.

    PG-RLSTM is taken 1 % better than in the paper, whose 57.1 % over the MLP is rounded up.
    """
    errors = {name: {amps: [cell.mean] * 10 for amps, cell in row.items()} for name, row in paper.FIGURE_4.items()}
    errors["pg_rlstm"] = {amps: [0.99 * value for value in values] for amps, values in errors["pg_rlstm"].items()}
    rows = {name: learn.summary(values) for name, values in errors.items()}
    assert all(fig4.judge(rows).values())
    equal = {**rows, "lstm": learn.summary({**errors["lstm"], 1.2: [0.41] * 10})}
    assert not fig4.judge(equal)["pg_rlstm_lowest_at_each_current"]
    fig4.plot(rows, tmp_path / "figure4.png")
    assert (tmp_path / "figure4.png").stat().st_size > 10_000


def test_figure4_goes_on_where_it_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A model that is done is not trained again, unless the recipe or the bench changed."""
    calls: list[str] = []

    def train(name: str, *_: object) -> dict[str, object]:
        calls.append(name)
        values = {1.0: [0.3], 1.2: [0.3], 1.5: [0.3]}
        return {"summary": learn.summary(values), "bouc_wen": learn.bench_parameters(None)}

    monkeypatch.setattr(fig4, "_train", train)
    monkeypatch.setattr(fig4, "run_bench", lambda cfg: None)
    recipe = FitCfg()
    for _ in range(2):
        fig4.train(BenchCfg(), recipe, tmp_path)
    assert calls == ["bouc_wen", "mlp", "lstm", "pg_rlstm"]
    fig4.train(BenchCfg(), replace(recipe, epochs=7), tmp_path)
    assert len(calls) == 8
    [kept] = tmp_path.rglob("mlp.json")
    for damage in ("[" * 100_000, "{"):
        kept.write_text(damage)
        with pytest.raises(ValueError, match="mlp.json: not JSON: .*; remove it"):
            fig4.train(BenchCfg(), recipe, tmp_path)
