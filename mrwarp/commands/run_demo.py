"""``mrwarp demo``: from nothing to a picture of a robot that walks on brakes, and to a joint next to its recording."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from mrwarp.commands.run_play import Play
from mrwarp.options import option_types as opt
from mrwarp.options.command_line import CommandLine, Options
from mrwarp.options.progress_bar import ProgressBar
from mrwarp.resources import DEFAULT_POLICY

SECONDS = 4.0
"""Time that the robots walk [s]: five instants of two strides each."""

RUNS, SAMPLES = 8, 6400
"""Size of the joint's recording: two runs at each current, 4 s long; the fit takes a few seconds."""


@dataclass(frozen=True, kw_only=True)
class Demo(Options):
    """See what this is about, in two minutes on two cores: two pictures, by the shipped policy and the paper's device.

    walk.png shows four robots that walk with MR brakes at their calves, one per coil current. loop.png shows a joint's
    simulated torque over the recording that it was identified from; the virtual bench makes that.
    """

    out: opt.Folder = Path("runs/demo")
    """output folder: walk.png, loop.png"""

    def run(self, line: CommandLine) -> int:
        """0 when both pictures are written."""
        progress = ProgressBar()
        progress.note(
            "four robots walk on brakes, one per coil current; kernels are compiled the first time, half a minute"
        )
        walk, loop = self.out / "walk.png", self.out / "loop.png"
        words = ("--policy", str(DEFAULT_POLICY), "--png", str(walk), "--seconds", f"{SECONDS:g}", "--z-step", "exact")
        play = Play(policy=str(DEFAULT_POLICY), png=walk, seconds=SECONDS)  # its plant has the exact step
        if code := play.run(CommandLine("mrwarp play", words)):
            return code

        from mrwarp.bench.virtual_bench import BenchCfg, run_bench
        from mrwarp.identify.fit import fit
        from mrwarp.identify.fit_pictures import loops_picture

        progress.note("recording a joint on the virtual bench, and fitting eq. 14 to the recording")
        recording = run_bench(BenchCfg(trajectories=RUNS, samples=SAMPLES, evaluation_samples=0)).fit
        fitted = fit(recording)
        loops_picture(recording, fitted, None, loop)
        left = f"{100 * fitted.nrmse:.1f} %"
        print(f"eq. 14 leaves {left} of the joint's torque unexplained; 'mrwarp diagnose joint' looks for the causes")
        here = Path.cwd()
        policy = DEFAULT_POLICY.relative_to(here) if DEFAULT_POLICY.is_relative_to(here) else DEFAULT_POLICY
        print(
            f"\n{walk}: robots that walk on brakes\n{loop}: a joint's loops next to its recording\n"
            f"({progress.seconds:.0f} s) Next: mrwarp play --policy {policy} opens a viewer, "
            "mrwarp device list shows real devices, mrwarp --help the rest"
        )
        return 0
