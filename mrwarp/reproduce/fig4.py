"""Figure 4: RMSE of four torque models on ten unseen trajectories of the virtual bench, with the shipped networks.

``mrwarp reproduce fig4 --train`` trains them anew, see :mod:`mrwarp.reproduce.figure4`.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

from mrwarp import paper
from mrwarp.nn import model_file
from mrwarp.nn.models import SAMPLES, LstmState
from mrwarp.reproduce import figure4
from mrwarp.reproduce.experiment import Experiment, Findings, Job, NotYet, Row
from mrwarp.reproduce.settings import Settings
from mrwarp.sysid import learn
from mrwarp.sysid.bench import BenchCfg, run_bench

TITLES = {"mlp": "MLP", "bouc_wen": "Bouc-Wen", "lstm": "LSTM", "pg_rlstm": "PG-RLSTM"}
"""As the paper writes them."""

FITTING = 1000
"""Samples of fitting data that are recorded and not used; the evaluation does not depend on them."""

WHY = (
    "The bench is ours: its effects beyond eq. 14 are milder than the real device's, on which the paper's Bouc-Wen "
    "model leaves {paper:.3f} N·m and ours {ours:.3f} N·m at {amps:g} A."
)


def compute(job: Job) -> Findings:
    """Evaluate the shipped networks and the Bouc-Wen model they stand beside."""
    bench = BenchCfg(samples=FITTING, trajectories=1)
    data = run_bench(bench, lambda share, text: job.report("bench", 0.8 * share)).evaluation
    assert data is not None  # the default records it
    models = {name: model_file.load(path) for name, path in zip(SAMPLES, networks(), strict=True)}
    job.report("networks", 0.8)
    torque = {name: learn.predict(model, data) for name, model in models.items()}
    torque["bouc_wen"] = learn.bouc_wen_torque(data, models["pg_rlstm"].bouc_wen)
    found = {name: learn.summary(learn.errors(torque[name], data)) for name in figure4.MODELS}
    carried = {
        name: learn.summary(learn.errors(learn.predict(models[name], data, lstm_state=LstmState.CARRIED), data))
        for name in ("lstm", "pg_rlstm")
    }
    figure4.plot({"1": found}, job.out / "figure4.png")
    rows = []
    for name in figure4.MODELS:
        for amps, theirs in paper.FIGURE_4[name].items():
            cell, plain = found[name]["by_current"][f"{amps:g}"], found["bouc_wen"]["by_current"][f"{amps:g}"]
            why = WHY.format(paper=paper.FIGURE_4["bouc_wen"][amps].mean, ours=plain["mean"], amps=amps)
            rows.append(
                Row(condition=f"{TITLES[name]}, {amps:g} A", quantity="RMSE", unit="N·m", paper=theirs,
                    ours=cell["mean"], sd=cell["sd"], n=cell["trajectories"], why=why)
            )  # fmt: skip
    verdicts = figure4.judge(found)
    claims = {
        "PG-RLSTM has the lowest error at each current": verdicts["pg_rlstm_lowest_at_each_current"],
        f"its average is at most {paper.FIGURE_4_AVERAGE:g} N·m": verdicts["pg_rlstm_average"],
        **{
            f"it is at least {100.0 * wanted:.1f} % below {TITLES[name]}": verdicts[f"lower_than_{name}"]
            for name, wanted in paper.FIGURE_4_REDUCTION.items()
        },
    }
    return Findings(
        rows=rows, claims=claims,
        notes=[
            "Spreads are over the ten trajectories. The data are the virtual bench's, not the paper's device.",
            "The rows start the LSTMs over with 50 samples at every step, as the paper does. With their state carried "
            "on along a trajectory, as the simulation does, the same networks leave "
            + " and ".join(
                f"{row['average']:.3f} instead of {found[name]['average']:.3f} N·m ({TITLES[name]})"
                for name, row in carried.items()
            )
            + " on average.",
        ],
        pictures={"figure4.png": "RMSE by current, marks the paper's; right: averages over the currents"},
        figures={"models": found, "carried": carried},
    )  # fmt: skip


def networks(settings: Settings | None = None) -> Sequence[Path]:
    """The shipped networks.

    Raises:
        NotYet: one is not there.
    """
    found = {name: model_file.shipped_model(name) for name in SAMPLES}
    if missing := [name for name, path in found.items() if path is None]:
        raise NotYet(f"no trained network for {', '.join(missing)}; run 'mrwarp reproduce fig4 --train'")
    return [Path(path) for path in found.values() if path is not None]


EXPERIMENT = Experiment(name="fig4", title="Figure 4: torque prediction", compute=compute, files=networks)
