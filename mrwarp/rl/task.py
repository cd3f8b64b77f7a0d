"""What a policy was trained on: the part of a configuration that checkpoints and policies carry."""

from __future__ import annotations

import json
from dataclasses import asdict
from pathlib import Path
from typing import Any

from mrwarp.env.cfg import EnvCfg
from mrwarp.nn.network_file import MODELS, shipped_model
from mrwarp.rl.ppo_cfg import LearningCfg


def task(cfg: EnvCfg) -> dict[str, Any]:
    """What a policy was trained on, as plain values."""
    return {
        "robot": cfg.robot,
        "payload": cfg.payload,
        "asset": cfg.asset,
        "actuator": cfg.actuator_model,
        "actuator_file": _portable(cfg),
        "lstm_state": cfg.lstm_state.value if "lstm" in cfg.actuator_model else None,
        "model": cfg.model if isinstance(cfg.model, str | None) else cfg.model.fitted_on.source,
        "coupling": cfg.actuator.coupling.value,
        "hold_current": cfg.actuator.hold_current.value,
        "z_step": cfg.actuator.z_step.value,
        "sal": cfg.actuator.sal,
        "terrain": "rough" if cfg.terrain else "flat",
        "gains": list(cfg.gains) if cfg.gains else None,
        "randomize": _plain(cfg.randomize),
        "rewards": _plain(cfg.rewards),
        "num_envs": cfg.sim.num_envs,
        "device": cfg.sim.device,
        "engine": cfg.sim.engine.value,
        "action_scale": cfg.action_scale,
        "step_dt": cfg.step_dt,
        "gait_frequency": cfg.gait_frequency,
    }


def learned(content: dict[str, Any]) -> dict[str, float]:
    """What a checkpoint or result says of how fast its networks learned; files of earlier versions say nothing."""
    said = content.get("learning")
    return {**asdict(LearningCfg()), **(said if isinstance(said, dict) else {})}


def _plain(part: Any) -> dict[str, Any] | None:
    """A part of a configuration as JSON gives it back, so that it can be compared with a saved one."""
    return json.loads(json.dumps(asdict(part))) if part else None


def _portable(cfg: EnvCfg) -> str | None:
    """The learned model's file; of a shipped one its name, which is the same in every checkout."""
    file = cfg.actuator_file
    return f"{MODELS.name}/{Path(file).name}" if file and file == shipped_model(cfg.actuator_model) else file
