"""Closed sets of choices that command lines offer; loads nothing, so that ``--help`` need not wait for an engine."""

from __future__ import annotations

import enum


class Coupling(enum.Enum):
    """How the device acts on the joint."""

    EXPLICIT = "explicit"
    CONSTRAINT = "constraint"


class HoldCurrent(enum.Enum):
    """Current while holding: the support current for the needed torque (section 5.2), or I_e (current sweeps)."""

    SUPPORT = "support"
    FIXED = "fixed"


class ZStep(enum.Enum):
    """Step of the hysteresis state: the paper's explicit Euler, or the closed form for constant velocity."""

    EULER = "euler"
    EXACT = "exact"


class BackendKind(enum.Enum):
    """Which engine steps the physics."""

    MJBATCH = "mjbatch"
    MJWARP = "mjwarp"


LEARNED = ("mlp", "lstm", "pg_rlstm")
"""Torque models that come from a file: ``mrwarp learn`` writes it."""

ACTUATORS = ("none", "mlp", "lstm", "bouc_wen", "pg_rlstm")
"""Torque models of the MR joint that can be simulated: no device at all, the current-aware Bouc-Wen model, a learned
torque in its place, or a learned residual on it."""

TERRAINS = ("flat", "rough")
"""Grounds to train on: a plane, or the height field of :mod:`mrwarp.env.terrain`."""

RANDOMIZATIONS = ("all", "ground", "none")
"""What differs between training environments, see :func:`mrwarp.env.cfg.make_randomize_cfg`."""
