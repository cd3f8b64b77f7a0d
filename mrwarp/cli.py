"""``mrwarp <command>``: one entry for everything that computes. Each command's options live beside its code."""

from __future__ import annotations

import difflib
import importlib
import os
import sys

from mrwarp.run_dir import one_line

COMMANDS = {
    "train": ("mrwarp.commands.run_train", "train a walking policy until the walking gate is met"),
    "play": ("mrwarp.commands.run_play", "run a policy and show it in rerun, or save an .rrd or a picture"),
    "sweep": ("mrwarp.commands.run_sweep", "run a command over a grid of seeds, models, currents; resumable"),
    "replay-dump": ("mrwarp.commands.run_replay_dump", "what went wrong first where a training met NaN or a blow-up"),
    "impact": ("mrwarp.commands.run_impact", "hit walking robots with each current; live view, recording, pictures"),
    "walk": ("mrwarp.commands.run_walk", "walk 30 m with three robots: cost of transport, support activation, torques"),
    "mission": ("mrwarp.commands.run_mission", "150 m out, stand, 150 m back: power, state of charge, temperatures"),
    "bench": ("mrwarp.commands.run_bench", "virtual torque bench: recordings with known hidden effects"),
    "check": ("mrwarp.commands.run_check", "explain a recording, or what is wrong with it"),
    "fit": ("mrwarp.commands.run_fit", "identify the joint from recordings"),
    "diagnose": (
        "mrwarp.commands.run_diagnose",
        "what the simulation gets wrong, why, and what it gains to put that right",
    ),
    "learn": ("mrwarp.commands.run_learn", "train and evaluate the learned torque models"),
    "reproduce": ("mrwarp.commands.run_reproduce", "the paper's figures and tables, ours beside theirs"),
    "study": (
        "mrwarp.commands.run_study",
        "actuator-aware against conventional training: train the policies, tables 2 and 3",
    ),
    "perf": ("benchmarks.perf.perf_cli", "what a step costs, part by part, and whether that got worse"),
    "asset": ("mrwarp.commands.run_asset", "show, check, change and compare USD assets"),
    "verify": ("mrwarp.commands.run_verify", "measure what the simulator promises: passivity, holding, accuracy"),
}
"""Command name to the module whose ``main(argv)`` runs it, and its one-line help."""


def main(argv: list[str] | None = None) -> int:
    """Run a command; returns its exit code: 0 done, 1 measured but missed, 2 bad input, 130 stopped by Ctrl-C."""
    argv = sys.argv[1:] if argv is None else argv
    if not argv or argv[0] in ("-h", "--help"):
        print(_usage())
        return 0 if argv else 2
    if argv[0] not in COMMANDS:
        near = difflib.get_close_matches(argv[0], COMMANDS, n=1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        print(f"mrwarp: there is no command {argv[0]!r}; {hint}see mrwarp --help", file=sys.stderr)
        return 2
    module, _ = COMMANDS[argv[0]]
    try:
        code = importlib.import_module(module).main(argv[1:])
        sys.stdout.flush()
        return code
    except KeyboardInterrupt:
        print("\nstopped", file=sys.stderr)
        return 130
    except BrokenPipeError:  # whoever read the output has gone, as in `mrwarp ... | head`
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except OSError as error:  # most of them a disk that is full when the results are written
        remedy = "make room or name another folder, then run it again"
        print(f"mrwarp {argv[0]}: {one_line(error)}; {remedy}", file=sys.stderr)
        return 1


def _usage() -> str:
    lines = [f"  {name:12s} {text}" for name, (_, text) in COMMANDS.items()]
    return "\n".join(
        ["usage: mrwarp COMMAND [options]", "", "commands:", *lines, "", "'mrwarp COMMAND --help' lists its options"]
    )


if __name__ == "__main__":
    sys.exit(main())
