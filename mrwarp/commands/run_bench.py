"""``mrwarp bench``: run the virtual torque bench and write its recordings."""

from __future__ import annotations

import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from tyro.conf import UseAppendAction

from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options, given
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.run_dir import check_writable, write_result
from mrwarp.runtime import drawing, quiet_libraries

if TYPE_CHECKING:
    from mrwarp.bench.virtual_bench import BenchCfg, BenchData

SHORT = {"trajectories": 32, "samples": 51_200, "evaluation_samples": 0}
"""A session that is diagnosed in seconds, for --only."""

PARTS = ("fit", "evaluation")
"""Folders of the recordings."""


@dataclass(frozen=True, kw_only=True)
class Bench(Options):
    """Virtual torque bench: drives one MR joint along prescribed motion and logs it at 200 Hz.

    Writes DIR/fit, DIR/evaluation, DIR/holding.csv, DIR/bench.png and DIR/result.json.
    """

    networks = False  # unless a policy gives the motion
    out: opt.Folder = Path("runs/bench")
    """output folder"""
    overwrite: opt.Flag = False
    """replace recordings that are already there"""
    effect: UseAppendAction[tuple[Annotated[tuple[str, float], opt.one(opt.assignment, "NAME=VALUE")], ...]] = ()
    """set one effect, such as coil_lag=0.02 [s], cogging=0.3 [N·m] or backlash=0.01 [rad]; see --list-effects"""
    only: UseAppendAction[tuple[Annotated[tuple[str, float], opt.one(opt.assignment, "NAME=VALUE")], ...]] = ()
    """hide this effect and no other, such as coil_lag=0.012, with the noise of a good stand; a session of 32 short runs
    unless --trajectories and --samples say else"""
    list_effects: opt.Flag = False
    """print all effects with defaults and reasons"""
    scale_effects: Annotated[float, opt.one(opt.within(0.0, 10.0, ""), "X")] = 1.0
    """factor on the strength of all effects and noise; 0 leaves only those given by --effect"""
    seed: opt.Seed = 0
    """seed of motions, currents and noise"""
    trajectories: opt.Count = 120
    """trajectories to fit"""
    samples: opt.Count = 665_442
    """their samples in total"""
    evaluation_samples: opt.Whole = 4000
    """samples of each of the 30 evaluation trajectories; 0 for none"""
    policy: opt.OptionalFile = None
    """take the calf motion from this walking policy (.onnx)"""
    asset: opt.OptionalFile = None
    """bench asset, such as assets/usd/mr_bench.usda (default: the paper's device)"""
    format: Literal["csv", "parquet"] = "csv"
    """file type"""
    progress: bool = True
    """show progress"""

    def run(self, line: CommandLine) -> int:
        """0 when the recordings are written, 2 on bad input, 130 when stopped by Ctrl-C."""
        from mrwarp.bench.bench_effects import Effects
        from mrwarp.bench.session_report import effect_table

        if self.list_effects:
            print(effect_table(Effects.defaults(), all_of_them=True))
            return 0
        cfg = self._cfg(line)
        there = [f for part in PARTS if (self.out / part).is_dir() for f in sorted((self.out / part).iterdir())]
        if there and not self.overwrite:
            raise ValueError(f"{there[0].parent} holds recordings already; choose another --out or add --overwrite")
        check_writable(self.out)
        try:
            return self._run(cfg, line)
        except KeyboardInterrupt:
            left = f"{self.out} is incomplete" if self.out.exists() else "nothing was written"
            raise KeyboardInterrupt(left) from None

    def _cfg(self, line: CommandLine) -> BenchCfg:
        from mrwarp.bench.bench_effects import Effects
        from mrwarp.bench.virtual_bench import BenchCfg, bench_device

        device = bench_device()
        if self.asset is not None:
            from mrwarp.usd.asset import load_bench

            device = load_bench(self.asset).actuators[0].mr or device
        chosen = self.chosen("trajectories", "samples", "evaluation_samples", "policy", "seed")
        if not self.only:
            effects = Effects.defaults(self.scale_effects).replace(**dict(self.effect))
            return BenchCfg(**chosen, effects=effects, params=device)
        if self.effect or self.scale_effects != 1.0:
            raise ValueError("--only hides these effects and no others; leave --effect and --scale-effects out")
        chosen |= {name: value for name, value in SHORT.items() if name not in given(line, Bench)}
        return BenchCfg(**chosen, effects=Effects.alone(**dict(self.only)), params=device)

    def _run(self, cfg: BenchCfg, line: CommandLine) -> int:
        from mrwarp.bench import session_report, virtual_bench
        from mrwarp.bench.bench_effects import LOG_DT, SUBSTEPS
        from mrwarp.recording.load import HOLDING_FILE

        started, shown = time.perf_counter(), ProgressBar(sys.stderr)

        def show(share: float, text: str) -> None:
            if self.progress:
                shown(text, share)

        actor = None
        if cfg.policy is not None:
            quiet_libraries(gpu=False)
            from mrwarp.rl.policy import OnnxPolicy
            from mrwarp.trials.walking import calf_motion

            actor = partial(calf_motion, OnnxPolicy(cfg.policy), str(cfg.policy))
        try:
            pool = None
            if actor is not None:
                show(0.0, "walking")
                pool = actor(seconds=cfg.longest + 10.0, dt=LOG_DT / SUBSTEPS, seed=cfg.seed)
            data = virtual_bench.run_bench(cfg, show, pool)
            self._write(data, show)
            show(1.0, "comparing with eq. 14")
            figures = session_report.measure(data, cfg)
            figures["seconds"] = round(time.perf_counter() - started, 1)
            write_result(self.out, figures, seed=cfg.seed, command=str(line))
            with drawing("bench.png"):
                session_report.draw(data, cfg, self.out / "bench.png")
        finally:
            shown.done()
        print("\n".join(session_report.lines(figures, cfg)))
        print(f"\nrecordings, {HOLDING_FILE}, bench.png and result.json in {self.out}")
        return 0

    def _write(self, data: BenchData, show: Callable[[float, str], Any]) -> None:
        """Write the recordings, in place of earlier ones."""
        from mrwarp.recording.load import save_holding, save_recording

        kind = ".csv.gz" if self.format == "csv" else ".parquet"
        for part, recording in zip(PARTS, (data.fit, data.evaluation), strict=True):
            for old in sorted((self.out / part).glob("*")) if self.overwrite else []:
                if old.name.endswith((".csv.gz", ".parquet")):
                    old.unlink()
            if recording is not None:
                show(1.0, f"writing {self.out / part}")
                save_recording(recording, self.out / part, kind=kind)
        save_holding(data.holding, self.out)
