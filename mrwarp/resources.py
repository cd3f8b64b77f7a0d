"""Policies and networks that come with the package."""

from __future__ import annotations

import difflib
from pathlib import Path

from mrwarp.enums import EXPLICIT, Coupling

_HERE = Path(__file__).resolve().parent
POLICIES = next((p for p in (_HERE / "policies", _HERE.parent / "policies") if p.is_dir()), _HERE / "policies")
"""Folder of the shipped policies: inside the package when installed as a wheel, next to it in a checkout."""

ENERGY = POLICIES / "energy"
"""Shipped policies of the robots of tables 6 and 7, each trained on its own robot, with their training records."""

FIRST_SEEDS = (0, 1, 2)
"""Training seeds that every folder of policies has."""

DEFAULT_POLICY = POLICIES / "mr_go_walk.onnx"
"""The shipped walking policy of the quadruped with MR calves."""

MODELS = next((p for p in (_HERE / "models", _HERE.parent / "models") if p.is_dir()), _HERE / "models")
"""Folder of the shipped networks: inside the package when installed as a wheel, next to it in a checkout."""

DEVICES = MODELS / "devices"
"""Library of identified devices: a folder each, with ``model.json`` and ``device.json``."""

META = "mrwarp"
"""Key of the metadata entry of a policy or network that holds its description as JSON."""


def plant_of(robot: str, coupling: Coupling) -> str:
    """The plant that the policies of a robot of tables 6 and 7, whose devices act so, were trained on."""
    return EXPLICIT if robot == "mr_go_sal" and coupling is Coupling.EXPLICIT else robot


def policy_file(folder: Path, plant: str, seed: int) -> Path:
    """The policy of a plant and a training seed in a folder of policies."""
    return folder / f"{plant}_seed{seed}.onnx"


def shipped_model(kind: str) -> str | None:
    """File of the shipped network of a kind (``mlp``, ``lstm``, ``pg_rlstm``); None for what is not learned."""
    path = MODELS / f"{kind}.safetensors"
    return str(path) if path.is_file() else None


def device_names(library: Path = DEVICES) -> tuple[str, ...]:
    """Names of the devices of a library, in order."""
    return tuple(sorted(file.parent.name for file in library.glob("*/model.json")))


def model_path(named: str | Path) -> Path:
    """The model file that a name of the library stands for; a file of that name goes first, other text is a path."""
    path = Path(named)
    return DEVICES / path / "model.json" if not path.is_file() and str(path) in device_names() else path


def no_model(named: str | Path) -> str:
    """Suggestion in place of a model file that is not there."""
    near = difflib.get_close_matches(str(named), device_names(), n=1)
    hint = f"did you mean {near[0]}? " if near else ""
    return f"{hint}give the model.json that 'mrwarp fit' wrote, or a device of 'mrwarp device list'"
