"""Pictures of the pages, each made by commands that anyone can run: ``make gallery``.

``docs/images/gallery.json`` records of every picture its commands, commit and day, and a hash of each file that it
shows or that draws it. ``make lint`` runs ``python tools/gallery.py --only-check``: it fails where a picture is older
than what it shows.
"""

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # the paper's laboratory is not installed
from paper.reproduce.cache import file_hash  # noqa: E402

IMAGES = ROOT / "docs" / "images"
RECORD = IMAGES / "gallery.json"
WALK = "policies/mr_go_walk.onnx"
ROBOT = "assets/usd/mr_go.usda"
DRAWN = ("mrwarp/viewing/robot_pictures.py", "mrwarp/viewing/shapes.py")


@dataclass(frozen=True, kw_only=True)
class Picture:
    """A picture and where it comes from."""

    commands: tuple[str, ...]
    """Arguments of ``mrwarp``, run one after the other in a folder of their own."""
    made: str
    """The file that they leave there."""
    shows: tuple[str, ...]
    """Files that it shows, and code that draws it, from the root of the checkout."""


PICTURES = {
    "walk.webp": Picture(
        commands=(f"play --policy {ROOT / WALK} --film walk.webp",),
        made="walk.webp",
        shows=(WALK, ROBOT, "mrwarp/viewing/film.py", "mrwarp/viewing/shapes.py"),
    ),
    "walk.png": Picture(
        commands=(f"play --policy {ROOT / WALK} --seconds 4 --png walk.png",),
        made="walk.png",
        shows=(WALK, ROBOT, *DRAWN),
    ),
    "impact.png": Picture(
        commands=(f"impact --policy {ROOT / WALK} --trials 4 --out impact",),
        made="impact/impact_constraint.png",
        shows=(WALK, ROBOT, *DRAWN, "mrwarp/trials/impact.py"),
    ),
    "robot.png": Picture(commands=("robot show mr_go --png robot.png",), made="robot.png", shows=(ROBOT, *DRAWN)),
    "walk_energy.png": Picture(
        commands=(f"play --policy {ROOT / 'policies/energy/mr_go_sal_seed0.onnx'} --seconds 4 --png walk.png",),
        made="walk.png",
        shows=("policies/energy/mr_go_sal_seed0.onnx", ROBOT, *DRAWN),
    ),
    "numbers.png": Picture(
        commands=("device show paper --png numbers.png",),
        made="numbers.png",
        shows=(
            *("mrwarp/devices/number_picture.py", "mrwarp/params.py", "mrwarp/kernels/bouc_wen.py"),
            *("mrwarp/kernels/brake.py", "models/devices/paper/model.json"),
        ),
    ),
    "diagnosis.png": Picture(
        commands=("bench --only coil_lag=0.012 --out bench", "diagnose joint bench/fit --out found"),
        made="found/pictures/loops.png",
        shows=("mrwarp/diagnose/report/trace_pictures.py", "mrwarp/bench/virtual_bench.py"),
    ),
}
"""By file of ``docs/images``."""


def digest(path: Path) -> str:
    """The first digits of a file's hash, in which the words of Python code do not count."""
    return file_hash(path)[:16]


def old(record: dict[str, Any]) -> list[str]:
    """Pictures that are missing or older than what they show, each as a line."""
    found = []
    for name, picture in PICTURES.items():
        known, file = record.get(name, {}), IMAGES / name
        if not file.is_file() or known.get("picture") != digest(file):
            found.append(f"docs/images/{name}: not made by its commands")
            continue
        changed = [path for path in picture.shows if known["shows"].get(path) != digest(ROOT / path)]
        if changed:
            found.append(f"docs/images/{name}: older than {', '.join(changed)}")
    return found


def make(name: str, picture: Picture) -> dict[str, Any]:
    """Run a picture's commands, keep the picture; returns its entry in the record."""
    git = ["git", "rev-parse", "--short=8", "HEAD"]
    environment = os.environ | {"PYTHONPATH": str(ROOT), "MUJOCO_GL": os.environ.get("MUJOCO_GL", "egl")}
    with tempfile.TemporaryDirectory() as folder:
        for command in picture.commands:
            print(f"mrwarp {command}", flush=True)
            words = [sys.executable, "-m", "mrwarp", *command.split()]
            subprocess.run(words, cwd=folder, env=environment, check=True)
        shutil.copy(Path(folder) / picture.made, IMAGES / name)
    commit = subprocess.run(git, cwd=ROOT, capture_output=True, text=True, check=True)
    return {
        "commands": [re.sub(rf"{re.escape(str(ROOT))}/", "", command) for command in picture.commands],
        "commit": commit.stdout.strip(),
        "day": datetime.now(UTC).date().isoformat(),
        "picture": digest(IMAGES / name),
        "shows": {path: digest(ROOT / path) for path in picture.shows},
    }


def main() -> int:
    """0 when all pictures are as new as what they show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("names", nargs="*", help="pictures to make (default: those that are old)")
    parser.add_argument("--only-check", action="store_true", help="make none; exit code 1 where one is old")
    chosen = parser.parse_args()
    record = json.loads(RECORD.read_text(encoding="utf-8")) if RECORD.is_file() else {}
    lines = old(record)
    if chosen.only_check:
        print("\n".join([*lines, "run 'make gallery'"] if lines else ["all pictures of the gallery are new"]))
        return int(bool(lines))
    for name in chosen.names or [Path(line.partition(":")[0]).name for line in lines]:
        if name not in PICTURES:
            parser.error(f"{name}: no picture of the gallery; choose from {', '.join(PICTURES)}")
        record[name] = make(name, PICTURES[name])
        RECORD.write_text(json.dumps(dict(sorted(record.items())), indent=1) + "\n", encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
