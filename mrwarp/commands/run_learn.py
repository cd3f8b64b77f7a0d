"""``mrwarp learn``: train a learned torque model on recordings and judge it on unseen trajectories."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from mrwarp.identify import learn
from mrwarp.model_file import load_model
from mrwarp.nn import network_file
from mrwarp.nn.models import LstmState
from mrwarp.nn.training import FitCfg, plot_history, print_epoch
from mrwarp.options.command_line import CommandLine
from mrwarp.options.data_options import Learn
from mrwarp.recording.load import load_recording
from mrwarp.run_dir import check_writable, write_result


def run(options: Learn, line: CommandLine) -> int:
    """Train and evaluate; 0 when done, 2 on bad input (nothing is written), 130 after Ctrl-C (the best is written)."""
    cfg = FitCfg(
        epochs=options.epochs,
        windows_per_epoch=options.windows_per_epoch,
        patience=options.patience,
        seed=options.seed,
    )
    bouc_wen = learn.bench_parameters(load_model(options.bouc_wen).values if options.bouc_wen else None)
    check_writable(options.out)
    folder, held_out = parts(options.data)
    recording = load_recording(folder)
    evaluation = load_recording(held_out) if held_out.is_dir() else None
    if evaluation and learn.sampling_interval(evaluation) != learn.sampling_interval(recording):
        raise ValueError(f"{held_out}: sampled at another rate than {options.data}; resample one of them")
    learned = learn.learn(recording, kind=options.model, bouc_wen=bouc_wen, cfg=cfg, report=print_epoch)
    model = replace(learned.model, source=str(options.data))
    figures = {**learned.figures, "bouc_wen": model.bouc_wen, "evaluation": None}
    if evaluation:
        torques = {
            "bouc_wen": learn.bouc_wen_torque(evaluation, bouc_wen), options.model: learn.predict(model, evaluation)
        }  # fmt: skip
        if "lstm" in options.model:  # as the simulation runs it
            torques[f"{options.model}, carried"] = learn.predict(model, evaluation, lstm_state=LstmState.CARRIED)
        figures["evaluation"] = {
            name: learn.summary(learn.errors(torque, evaluation)) for name, torque in torques.items()
        }
        print(learn.table(figures["evaluation"]))
    network_file.save(model, options.out / "model.safetensors")
    network_file.export_onnx(model, options.out / "model.onnx")
    plot_history(learned.history, options.model, options.out / "curves.png")
    write_result(options.out, figures, seed=options.seed, command=str(line))
    print(
        f"{options.model}: validation RMSE {figures['validation_rmse']:.3f} N·m at epoch {figures['best_epoch']} of "
        f"{figures['epochs']} ({figures['windows_seen']} windows drawn from {figures['training_windows']}, "
        f"{figures['seconds'] / 60:.1f} min); written to {options.out}"
    )
    return 130 if learned.history.stopped == "interrupted" else 0


def parts(data: Path) -> tuple[Path, Path]:
    """Where the fitting and the evaluation data are: DATA/fit and DATA/evaluation as the bench writes, or DATA."""
    if (data / "fit").is_dir():
        return data / "fit", data / "evaluation"
    return data, (data.parent if data.name == "fit" else data) / "evaluation"
