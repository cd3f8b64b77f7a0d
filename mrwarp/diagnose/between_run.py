"""Evidence within trajectories and between them: the latter is as many numbers as there are trajectories.

A factor of the torque that drifts over a session looks like wear and like a sensor whose gain is set anew for each
trajectory. Samples do not tell these apart, trajectories do.
"""

from __future__ import annotations

import numpy as np
from scipy.stats import t as student

from mrwarp.diagnose.engine import Engine, Fitted


def drift_p_value(engine: Engine, fit: Fitted, without: Fitted) -> float:
    """Chance that factors of trajectories in random order would follow what an effect foretells as closely.

    Args:
        engine: The data set.
        fit: The model with the effect.
        without: The model refitted without it.
    """
    s = engine.samples
    needed, foretold, weight = [], [], []
    for part in s.parts:
        tau = without.torque[part] - without.torque[part].mean()
        size = float(tau @ tau)
        if size <= 0.0:
            continue
        needed.append(float(tau @ (s.torque[part] - without.torque[part])) / size)
        foretold.append(float(tau @ (fit.torque[part] - without.torque[part])) / size)
        weight.append(np.sqrt(size))
    y, x = np.array(needed) * weight, np.array(foretold) * weight
    free = len(x) - 1 - sum(slot.effect not in without.effects for slot in fit.coordinates.slots)
    power = float(x @ x)
    if free < 1 or power <= 0.0:
        return 1.0
    slope = float(x @ y) / power
    error = np.sqrt(float(((y - slope * x) ** 2).sum()) / free / power)
    return float(student.sf(slope / max(error, 1e-300), free))


def gain_within(engine: Engine, fit: Fitted, without: Fitted) -> float:
    """What an effect gains beside an offset and a factor for each trajectory, in units of the noise's variance."""
    s, noise = engine.samples, engine.noise_model
    rows = noise.white(np.stack([s.torque - without.torque, s.torque - fit.torque, without.torque, np.ones(len(s.q))]))
    rows *= engine.weight
    gain = 0.0
    for part in s.parts:
        here = rows[:, part]
        basis = np.linalg.qr(here[2:].T)[0]
        left = here[:2] - (here[:2] @ basis) @ basis.T
        gain += float(left[0] @ left[0] - left[1] @ left[1])
    return gain
