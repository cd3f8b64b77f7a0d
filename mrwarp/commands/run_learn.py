"""``mrwarp learn``: train a learned torque model on recordings and judge it on unseen trajectories."""

from __future__ import annotations

import argparse
import shlex
import sys
from dataclasses import replace
from pathlib import Path

from mrwarp.identify import learn
from mrwarp.model_file import load_model
from mrwarp.nn import network_file
from mrwarp.nn.models import SAMPLES, LstmState
from mrwarp.nn.training import FitCfg, plot_history, print_epoch
from mrwarp.options.arguments import Parser, count, seed
from mrwarp.recording.load import load_recording
from mrwarp.run_dir import check_writable, one_line, write_result
from mrwarp.runtime import quiet_libraries


def make_parser() -> argparse.ArgumentParser:
    """The options of ``mrwarp learn``."""
    cfg = FitCfg()
    parser = Parser(
        prog="mrwarp learn",
        description="Train a torque model of an MR joint on bench recordings: a network alone (mlp, lstm), or an LSTM "
        "on what the Bouc-Wen model leaves (pg_rlstm). DATA/fit is used if it is there; DATA/evaluation judges only.",
    )
    parser.add_argument("data", type=Path, metavar="DATA", help="recording: a file or a folder")
    parser.add_argument("--out", type=Path, required=True, help="output folder")
    parser.add_argument("--model", choices=tuple(SAMPLES), default="pg_rlstm", help="kind (default: pg_rlstm)")
    parser.add_argument("--bouc-wen", type=Path, metavar="JSON", help="model.json of 'mrwarp fit' (default: the paper)")
    parser.add_argument("--epochs", type=count, default=cfg.epochs, help=f"most epochs (default: {cfg.epochs})")
    parser.add_argument(
        "--windows-per-epoch", type=count, default=cfg.windows_per_epoch,
        help=f"training windows drawn per epoch (default: {cfg.windows_per_epoch})",
    )  # fmt: skip
    patience = f"epochs without gain before stopping (default: {cfg.patience})"
    parser.add_argument("--patience", type=count, default=cfg.patience, help=patience)
    drawn = f"seed of division, weights and batches (default: {cfg.seed})"
    parser.add_argument("--seed", type=seed, default=cfg.seed, help=drawn)
    return parser


def main(argv: list[str] | None = None) -> int:
    """Train and evaluate; 0 when done, 2 on bad input (nothing is written), 130 after Ctrl-C (the best is written)."""
    argv = sys.argv[1:] if argv is None else argv
    args = make_parser().parse_args(argv)
    quiet_libraries()
    try:
        cfg = FitCfg(
            epochs=args.epochs, windows_per_epoch=args.windows_per_epoch, patience=args.patience, seed=args.seed
        )
        bouc_wen = learn.bench_parameters(load_model(args.bouc_wen).values if args.bouc_wen else None)
        check_writable(args.out)
        folder, held_out = parts(args.data)
        recording = load_recording(folder)
        evaluation = load_recording(held_out) if held_out.is_dir() else None
        if evaluation and learn.sampling_interval(evaluation) != learn.sampling_interval(recording):
            raise ValueError(f"{held_out}: sampled at another rate than {args.data}; resample one of them")
        learned = learn.learn(recording, kind=args.model, bouc_wen=bouc_wen, cfg=cfg, report=print_epoch)
    except (ValueError, OSError) as error:  # recordings, parameters and recipe raise kinds of ValueError
        print(f"mrwarp learn: {one_line(error)}", file=sys.stderr)
        return 2
    model = replace(learned.model, source=str(args.data))
    figures = {**learned.figures, "bouc_wen": model.bouc_wen, "evaluation": None}
    if evaluation:
        names = {"bouc_wen": learn.bouc_wen_torque(evaluation, bouc_wen), args.model: learn.predict(model, evaluation)}
        if "lstm" in args.model:  # as the simulation runs it
            names[f"{args.model}, carried"] = learn.predict(model, evaluation, lstm_state=LstmState.CARRIED)
        figures["evaluation"] = {
            name: learn.summary(learn.errors(tau, evaluation)) for name, tau in names.items()
        }  # fmt: skip
        print(learn.table(figures["evaluation"]))
    network_file.save(model, args.out / "model.safetensors")
    network_file.export_onnx(model, args.out / "model.onnx")
    plot_history(learned.history, args.model, args.out / "curves.png")
    write_result(args.out, figures, seed=args.seed, command="mrwarp learn " + shlex.join(argv))
    print(
        f"{args.model}: validation RMSE {figures['validation_rmse']:.3f} N·m at epoch {figures['best_epoch']} of "
        f"{figures['epochs']} ({figures['windows_seen']} windows drawn from {figures['training_windows']}, "
        f"{figures['seconds'] / 60:.1f} min); written to {args.out}"
    )
    return 130 if learned.history.stopped == "interrupted" else 0


def parts(data: Path) -> tuple[Path, Path]:
    """Where the fitting and the evaluation data are: DATA/fit and DATA/evaluation as the bench writes, or DATA."""
    if (data / "fit").is_dir():
        return data / "fit", data / "evaluation"
    return data, (data.parent if data.name == "fit" else data) / "evaluation"
