"""Figure 4: RMSE of four torque models on ten unseen trajectories of the virtual bench, with the shipped networks.

``mrwarp reproduce fig4 --train`` trains them anew, see :mod:`mrwarp.reproduce.figures.fig4_networks`.
"""

from __future__ import annotations

from mrwarp import paper
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.identify import learn
from mrwarp.nn import network_file as model_file
from mrwarp.nn.models import SAMPLES, LstmState
from mrwarp.reproduce import studied
from mrwarp.reproduce.experiment import Comparison, Experiment, Findings, Job
from mrwarp.reproduce.figures import fig4_networks as figure4
from mrwarp.reproduce.studied import PLANT_TITLES

FITTING = 1000
"""Samples of fitting data that are recorded and not used; the evaluation does not depend on them."""


def compute(job: Job) -> Findings:
    """Evaluate the shipped networks and the Bouc-Wen model they stand beside."""
    bench = BenchCfg(samples=FITTING, trajectories=1)
    data = run_bench(bench, lambda share, text: job.report("bench", 0.8 * share)).evaluation
    assert data is not None  # the default records it
    models = {name: model_file.load(path) for name, path in zip(SAMPLES, studied.networks(SAMPLES), strict=True)}
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
            rows.append(
                Comparison(condition=f"{PLANT_TITLES[name]}, {amps:g} A", quantity="RMSE", unit="N·m", paper=theirs,
                    ours=cell["mean"], sd=cell["sd"], n=cell["trajectories"],
                    why=why(amps, paper.FIGURE_4["bouc_wen"][amps].mean, plain["mean"]))
            )  # fmt: skip
    verdicts = figure4.judge(found)
    claims = {
        "PG-RLSTM has the lowest error at each current": verdicts["pg_rlstm_lowest_at_each_current"],
        f"its average is at most {paper.FIGURE_4_AVERAGE:g} N·m": verdicts["pg_rlstm_average"],
        **{
            f"it is at least {100.0 * wanted:.1f} % below {PLANT_TITLES[name]}": verdicts[f"lower_than_{name}"]
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
                f"{row['average']:.3f} instead of {found[name]['average']:.3f} N·m ({PLANT_TITLES[name]})"
                for name, row in carried.items()
            )
            + " on average.",
        ],
        pictures={"figure4.png": "RMSE by current, marks the paper's; right: averages over the currents"},
        figures={"models": found, "carried": carried},
    )  # fmt: skip


def why(amps: float, theirs: float, ours: float) -> str:
    """How our bench compares with the paper's device: by what either leaves to its Bouc-Wen model [N·m]."""
    return (
        f"The bench is ours: the paper's device leaves its Bouc-Wen model {theirs:.3f} N·m at {amps:g} A, our bench "
        f"{ours:.3f} N·m, so that the effects beyond eq. 14 are {'milder' if ours < theirs else 'no milder'} here."
    )


EXPERIMENT = Experiment(name="fig4", compute=compute, files=lambda settings: studied.networks(SAMPLES))
