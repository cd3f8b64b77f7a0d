"""Policies and networks that come with the package."""

from __future__ import annotations

import difflib
from pathlib import Path

_HERE = Path(__file__).resolve().parent
POLICIES = next((p for p in (_HERE / "policies", _HERE.parent / "policies") if p.is_dir()), _HERE / "policies")
"""Folder of the shipped policies: inside the package when installed as a wheel, next to it in a checkout."""

DEFAULT_POLICY = POLICIES / "mr_go_walk.onnx"
"""The shipped walking policy of the quadruped with MR calves."""

MODELS = next((p for p in (_HERE / "models", _HERE.parent / "models") if p.is_dir()), _HERE / "models")
"""Folder of the shipped networks: inside the package when installed as a wheel, next to it in a checkout."""

DEVICES = MODELS / "devices"
"""Library of identified devices: a folder each, with ``model.json`` and ``device.json``."""

META = "mrwarp"
"""Key of the metadata entry of a policy or network that holds its description as JSON."""


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
