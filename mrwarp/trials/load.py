"""Loads between and beyond the asset's payload variants."""

from __future__ import annotations

import numpy as np

from mrwarp.env.vec_env import WalkEnv

BODY = "payload"
"""Name of the payload's body in the asset."""

VARIANT = 3
"""Payload variant that has the body [kg]."""


def set_load(env: WalkEnv, load: np.ndarray) -> None:
    """Give the payload's body a mass per environment [kg], shape (E,); its inertia goes in proportion.

    Raises:
        ValueError: a load is negative, or the robot was built without the payload's body.
    """
    if np.any(load < 0.0):
        raise ValueError(f"load = {load.min():g} kg must not be negative")
    if env.cfg.payload == 0:
        if np.any(load > 0.0):
            raise ValueError(f"load = {load.max():g} kg needs the payload variant {VARIANT}")
        return
    # a body needs some mass: a gram is nothing to a robot of 12 kg
    env.sim.rescale_mass(BODY, np.maximum(load, 1e-3))


def total_mass(env: WalkEnv) -> float:
    """Mass of the robot as built, with its nominal payload [kg]."""
    return float(env.sim.scene.model.body_mass.sum())
