"""Hide causes in the virtual robot, diagnose its logs, and count how often cause and place are right.

Each case records a log with ``mrwarp log record``'s virtual robot, which is simulated by other code than the replay,
and diagnoses it. Of ``proposed`` the causes are those that a log of ``--motion`` cannot show, each recorded in the
motion that the verdict proposes. A case is a line of ``DIR/cases.jsonl``; cases that are there are not run again.
"""

from __future__ import annotations

import argparse
import contextlib
import functools
import json
import shutil
import tempfile
import time
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.robot_levels import HealthyLog, healthy_log, same_place
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.unknowable import MOTIONS
from mrwarp.robot_logs.virtual.described_robot import describe
from mrwarp.robot_logs.virtual.hidden_effects import Places, parse_all
from mrwarp.robot_logs.virtual.record_log import FallError, LogCfg, record
from mrwarp.run_dir import write_result
from mrwarp.runtime import check_device, quiet_libraries, text_table
from mrwarp.sysid.verdict import Value

FAMILIES = ("healthy", "single", "pair", "outside", "proposed")

MIXED = (("stand", 10.0), ("squat", 15.0), ("walk", 35.0))
"""A minute of motion on the ground [s]."""

AIR = (("chirp", 8.0), ("slow", 8.0))
"""Motion that leaves most to be proposed [s]."""

SIZES: dict[str, tuple[str, str]] = {
    "trunk_mass": ("trunk", "1.0"), "trunk_com": ("trunk", "-0.03"), "link_mass": ("calf", "0.15"),
    "link_com": ("calf", "0.01,0,0"),
    "link_length": ("calf", "0.015"), "rotor_inertia": ("joint", "0.01"), "coulomb_friction": ("joint", "0.8"),
    "viscous_friction": ("joint", "0.2"), "stribeck": ("joint", "1.0"), "backlash": ("joint", "0.015"),
    "motor_strength": ("joint", "0.85"), "torque_limit": ("calf joint", "10.0"), "kp": ("joint", "0.8"),
    "kd": ("joint", "1.8"), "command_delay": ("robot", "0.012"), "clock_shift": ("channel", "0.01"),
    "encoder_offset": ("joint", "0.04"), "velocity_lag": ("joint", "0.006"), "imu_tilt": ("robot", "0,0.04"),
    "gyro_bias": ("robot", "0,0,0.1"), "ground_friction": ("robot", "0.2"), "ground_slope": ("robot", "0,0.03"),
    "ground_stiffness": ("robot", "0.05"), "coil_dead": ("device", ""), "coil_lag": ("device", "0.03"),
    "device_strength": ("device", "0.6"), "device_drag": ("device", "0.8"), "hysteresis_law": ("device", ""),
    "command_lag": ("joint", "0.012"), "torque_lag": ("joint", "0.012"), "gravity_compensation": ("joint", "1.0"),
    "torque_channel_offset": ("joint", "1.0"), "torque_channel_gain": ("joint", "0.7"),
    "torque_channel_gravity": ("joint", "-1.0"),
    "series_elasticity": ("joint", "8.0"), "base_compliance": ("robot", "6.0"),
}  # fmt: skip
"""Places of each cause, and the size from which it is a fault; it is larger where that is less than ``--level``."""

OUTSIDE = {"tail_weight": "0.8", "cable_pull": "12", "soft_foot=FL": "0.05", "wind": "7"}
"""Effects that no catalogue holds."""


def places_of(cause: str, places: Places) -> list[str]:
    """Every place that a cause can have."""
    kinds = {
        "joint": places.joint, "calf joint": [j for j in places.joint if j in places.device], "device": places.device,
        "calf": [b for b in places.body if b in places.device], "channel": ("imu", "commands"),
    }  # fmt: skip
    return list(kinds.get(SIZES[cause][0], [""]))


def text_of(cause: str, place: str, numbers: str) -> str:
    """As ``--hide`` takes it."""
    return f"{cause}={':'.join(x for x in (place, numbers) if x)}"


def hidden_of(family: str, case: int, places: Places, causes: Sequence[str]) -> list[str]:
    """Causes that a case hides: in turn, each at its places in turn; a pair takes the next cause but some with it."""
    if family == "healthy":
        return []
    if family == "outside":
        name, size = list(OUTSIDE.items())[case % len(OUTSIDE)]
        return [f"{name}{':' if '=' in name else '='}{size}"]
    found = []  # of "proposed" the causes are those that a log cannot show
    for k in range(1 + (family == "pair")):
        cause = causes[(case + k * (1 + case // len(causes))) % len(causes)]
        where = places_of(cause, places)
        place = where[(case // len(causes) * 5 + case % len(causes) + 3 * k) % len(where)]
        found.append(text_of(cause, place, SIZES[cause][1]))
    return list(dict.fromkeys(found))


def enlarged(text: str, log: HealthyLog, places: Places, level: float) -> tuple[str, float | None]:
    """As ``--hide`` takes it, of a size that has a level; and the level that it has, see :class:`HealthyLog`."""
    hidden, found = log.size(parse_all([text], places)[0], level)
    place = hidden.where if places_of(hidden.cause, places) != [""] else ""
    numbers = ",".join(f"{x:.4g}" for x in hidden.values) if SIZES[hidden.cause][1] else ""
    return text_of(hidden.cause, place, numbers), found


def unknown_causes(args: argparse.Namespace) -> list[str]:
    """Causes that a healthy log of ``args.motion`` cannot show, and for which a motion is proposed."""
    with tempfile.TemporaryDirectory(prefix="robot_confusion_") as folder:
        record(log_cfg(args), Path(folder))
        d = diagnose_log(Path(args.robot), load_log(Path(folder)), device=args.device)
    listed = [text.partition(":")[0].partition(" of ")[0] for text in d.cannot_know]
    return [cause for cause in dict.fromkeys(listed) if cause in MOTIONS and cause in args.causes]


def run_case(
    case: int, causes: Sequence[str], logs: Callable[[LogCfg], HealthyLog], args: argparse.Namespace
) -> dict[str, Any]:
    """Record, diagnose, compare; ``logs`` give sizes."""
    family, places, levels = args.family, describe(args.robot).places, [None]
    hide, cfg = hidden_of(family, case, places, causes), log_cfg(args)
    if family == "proposed":
        cfg = replace(cfg, motions=tuple(MOTIONS[causes[case % len(causes)]].record.items()))
    if family in ("single", "pair", "proposed"):
        hide, levels = zip(*(enlarged(x, logs(cfg), places, args.level) for x in hide), strict=True)
    folder = Path(tempfile.mkdtemp(prefix="robot_confusion_"))
    started = time.process_time()
    try:
        cfg = replace(cfg, hide=tuple(hide), seed=1000 * args.seed + case)
        with contextlib.suppress(OSError):
            record(cfg, folder)
        truth = json.loads((folder / "truth.json").read_text())["hidden"]
        d = diagnose_log(Path(args.robot), load_log(folder), device=args.device)
    except FallError as error:
        return {"family": family, "case": case, "hide": hide, "levels": levels, "fell": str(error)}
    finally:
        shutil.rmtree(folder, ignore_errors=True)
    named = [
        {"name": c.name, "where": c.where, "alternatives": list(c.alternatives), "sizes": _sizes(c.parameters)}
        for c in d.causes
    ]
    return {
        "family": family, "case": case, "motions": cfg.motions, "hide": hide, "levels": levels, "truth": truth,
        "named": named,
        "verdict": d.verdict,
        "suspects": [f"{s.name} {s.reason}" for s in d.suspects], "cannot_know": list(d.cannot_know),
        "unexplained": d.unexplained is not None, "cpu_seconds": time.process_time() - started,
    }  # fmt: skip


def log_cfg(args: argparse.Namespace) -> LogCfg:
    """A healthy log of the suite."""
    return LogCfg(robot=args.robot, motions=tuple(args.motion), policy=args.policy, seed=1000 * args.seed)


def _sizes(parameters: Mapping[str, Value]) -> dict[str, tuple[float, ...]]:
    """Value and both ends of the interval of each number of a cause."""
    return {name: (x.value, *x.ci95) for name, x in parameters.items()}


def judged(row: dict[str, Any]) -> str:
    """Outcome of a case: right, ambiguous, place, unknowable, missed, wrong; without a truth none, unexplained, wrong.

    Unknowable is what was missed and is listed, with its place, as what the log cannot show.
    """
    if "fell" in row:
        return "fell"
    named = [(c["name"], c["where"]) for c in row["named"]]
    truth = [(t["cause"], t["where"]) for t in row["truth"] if t["catalogued"]]
    right = [t for t in truth if any(_same(t, c) for c in named)]
    false = [c for c in named if not any(t[0] == c[0] for t in truth)]
    if not truth:
        return "wrong" if named else "unexplained" if row["unexplained"] else "none"
    if len(right) == len(truth) and not false:
        return "right"
    if false:
        missing = [t for t in truth if t not in right]
        near = [x for c in row["named"] for x in c["alternatives"]]
        among = all(any(x.startswith(t[0]) for x in near) for t in missing)
        return "ambiguous" if missing and among and len(false) <= len(missing) else "wrong"
    if named:
        return "place"
    return "unknowable" if all(_listed(t, row.get("cannot_know", [])) for t in truth) else "missed"


def _listed(truth: tuple[str, str], unknown: Sequence[str]) -> bool:
    """Whether a cause at its place is among what the log cannot show."""
    for text in unknown:
        cause, _, places = text.partition(":")[0].partition(" of ")
        if cause == truth[0] and (not places or any(_same(truth, (cause, x)) for x in places.split(", "))):
            return True
    return False


def _same(truth: tuple[str, str], named: tuple[str, str]) -> bool:
    """Same cause and place; a body may carry the path of its file, and one IMU or trunk is the robot's."""
    return truth[0] == named[0] and (
        same_place(truth[1], named[1]) or truth[0] in ("imu_tilt", "gyro_bias", "trunk_mass", "trunk_com")
    )


def table(rows: list[dict[str, Any]]) -> list[str]:
    """Outcomes by what was hidden."""
    outcomes = ("right", "ambiguous", "place", "unknowable", "missed", "wrong", "none", "unexplained", "fell")
    kinds: dict[str, Counter] = {}
    for row in rows:
        names = "+".join(sorted(x.partition("=")[0] for x in row["hide"])) or "healthy"
        kinds.setdefault(names, Counter())[judged(row)] += 1
    kinds["all"] = sum(kinds.values(), Counter())
    shown = [o for o in outcomes if kinds["all"][o]]
    return text_table(("hidden", *shown), [(name, *(str(n[o]) for o in shown)) for name, n in kinds.items()])


def main() -> int:
    """Run the command."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.robot_confusion", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder of cases.jsonl and result.json")
    parser.add_argument("--family", choices=FAMILIES, default="single", help="what is hidden")
    parser.add_argument("--sets", type=int, default=12, help="number of cases")
    parser.add_argument("--first", type=int, default=0, help="first case: several processes share a suite")
    parser.add_argument("--seed", type=int, default=0, help="seed of the suite")
    parser.add_argument(
        "--level", type=float, default=0.4, help="least level of a cause, in healthy errors of the re-fitted simulation"
    )
    parser.add_argument("--causes", nargs="+", choices=list(SIZES), default=list(SIZES), help="only these")
    parser.add_argument("--robot", default="mr_go", help="mr_go, go1, a USD file or an arm")
    parser.add_argument("--device", default="cpu", help="cpu, or a GPU on which logs are replayed, such as cuda:0")
    parser.add_argument("--policy", type=Path, default=DEFAULT_POLICY, help="walking policy")
    parser.add_argument(
        "--motion",
        nargs="+",
        metavar="NAME=SECONDS",
        help="motions of every log",
        type=lambda x: (x.partition("=")[0], float(x.partition("=")[2] or 20.0)),
    )
    args = parser.parse_args()
    args.motion = args.motion or (AIR if args.family == "proposed" else MIXED)
    check_device(args.device)
    quiet_libraries(gpu=args.device != "cpu")
    file = args.out / "cases.jsonl"
    args.out.mkdir(parents=True, exist_ok=True)
    rows = [json.loads(line) for line in file.read_text().splitlines()] if file.exists() else []
    done = {(row["family"], row["case"]) for row in rows}
    logs, causes = functools.cache(functools.partial(healthy_log, device=args.device)), args.causes
    if args.family == "proposed":
        causes = unknown_causes(args)
        print(f"a log of {' '.join(name for name, _ in args.motion)} cannot show: {' '.join(causes)}", flush=True)
    for case in range(args.first, args.first + args.sets):
        if (args.family, case) in done:
            continue
        row = run_case(case, causes, logs, args)
        rows.append(row)
        with file.open("a") as stream:
            stream.write(json.dumps(row, default=lambda x: np.asarray(x).tolist()) + "\n")
        hidden = " ".join(row["hide"]) or "healthy"
        print(f"{case + 1 - args.first} of {args.sets}: {hidden}: {judged(row)}", flush=True)
    mine = [row for row in rows if row["family"] == args.family]
    print("\n".join(["", *table(mine)]))
    counts = Counter(judged(row) for row in mine)
    write_result(
        args.out, {"family": args.family, "outcomes": counts}, seed=args.seed, command=" ".join(parser.prog.split())
    )
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
