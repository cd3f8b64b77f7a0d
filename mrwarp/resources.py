"""Policies and networks that come with the package."""

from __future__ import annotations

from pathlib import Path

_HERE = Path(__file__).resolve().parent
POLICIES = next((p for p in (_HERE / "policies", _HERE.parent / "policies") if p.is_dir()), _HERE / "policies")
"""Folder of the shipped policies: inside the package when installed as a wheel, beside it in a checkout."""

DEFAULT_POLICY = POLICIES / "mr_go_walk.onnx"
"""The shipped walking policy of the quadruped with MR calves."""

MODELS = next((p for p in (_HERE / "models", _HERE.parent / "models") if p.is_dir()), _HERE / "models")
"""Folder of the shipped networks: inside the package when installed as a wheel, beside it in a checkout."""

META = "mrwarp"
"""Key of the metadata entry of a policy or network that holds its description as JSON."""


def shipped_model(kind: str) -> str | None:
    """File of the shipped network of a kind (``mlp``, ``lstm``, ``pg_rlstm``); None for what is not learned."""
    path = MODELS / f"{kind}.safetensors"
    return str(path) if path.is_file() else None
