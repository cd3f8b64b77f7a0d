"""Closed sets of choices that command lines offer; loads nothing, so that ``--help`` need not wait for an engine."""

from __future__ import annotations

import enum

from mrwarp.paper import ROBOTS


class Coupling(enum.Enum):
    """How the device acts on the joint."""

    EXPLICIT = "explicit"
    CONSTRAINT = "constraint"


class HoldCurrent(enum.Enum):
    """Current while holding: the support current for the needed torque (section 5.2), or I_e (current sweeps)."""

    SUPPORT = "support"
    FIXED = "fixed"


class CurrentCommand(enum.Enum):
    """Source of the coils' current: the gates and I_e alone; a law at 50 Hz; or the policy at 50 Hz, an action each.

    ``latched`` is the gates and I_e, with the hysteresis of a commanded coil's gates. See :mod:`mrwarp.env.commands`.
    """

    FIXED = "fixed"
    LATCHED = "latched"
    SCHEDULED = "scheduled"
    LEARNED = "learned"


BENCH_PARTS = {
    "inertia": ("rotor_inertia",),
    "gravity": ("gravity",),
    "friction": ("coulomb_friction", "friction_asymmetry"),
}
"""Parts of a bench that turn with the joint, and the effects that they show as: no robot's joint has them."""


class ZStep(enum.Enum):
    """Step of the hysteresis state: the paper's explicit Euler, or the closed form for constant velocity."""

    EULER = "euler"
    EXACT = "exact"


class ResidualEngine(enum.Enum):
    """Evaluates a learned torque: Warp kernels for the paper's networks, or torch, for any module."""

    KERNELS = "kernels"
    TORCH = "torch"


class LstmState(enum.Enum):
    """Where an LSTM's hidden and cell state come from at the newest sample."""

    CARRIED = "carried"
    """Those of the sample before, carried on: one sample of work per step. What is further back than the window of
    eq. 12 still counts, and predictions are better for it (models/README.md)."""
    WINDOW = "window"
    """Zero at the beginning of the last 50 samples (eq. 12), which are gone through again at every step."""


class BackendKind(enum.Enum):
    """Which engine steps the physics."""

    MJBATCH = "mjbatch"
    MJWARP = "mjwarp"


LEARNED = ("mlp", "lstm", "pg_rlstm")
"""Torque models that come from a file: ``mrwarp learn`` writes it."""

HYSTERESIS_LAWS = (
    "bouc_wen",
    "kwok",
    "arctangent",
    "dahl",
    "lugre",
    "bouc_wen_power",
    "spencer",
    "biviscous",
)
"""Hysteresis laws that can be fitted: the paper's eqs. 14 and 15, and the files of :mod:`mrwarp.effects.laws`."""

ACTUATORS = ("none", "mlp", "lstm", "bouc_wen", "pg_rlstm")
"""Torque models of the MR joint that can be simulated: no device at all, the current-aware Bouc-Wen model, a learned
torque in its place, or a learned residual on it."""

TERRAINS = ("flat", "rough")
"""Grounds to train on: a plane, or the height field of :mod:`mrwarp.env.terrain`."""

RANDOMIZATIONS = ("all", "ground", "none")
"""Differences between training environments, see :func:`mrwarp.env.config.mdp_cfg.make_randomize_cfg`."""

CONVENTIONAL = "conventional"
"""Trained on Go1, whose joints have no MR device: configurations A and B of table 2."""

MODELS = ("mlp", "bouc_wen", "lstm", "pg_rlstm")
"""Torque models of table 3, one training plant each: MR_Go with SAL on and four currents (eq. 20)."""

AWARE = "pg_rlstm"
"""The actuator-aware policies of configurations C and D: the paper's deployed torque model (section 6.1)."""

PLANTS = (CONVENTIONAL, AWARE, *(model for model in MODELS if model != AWARE))
"""Robots that a policy was trained on, by name; those of table 2 first, which is the order of training."""

PUBLIC = "public_gains"
"""The actuator-aware plant with :data:`mrwarp.usd.robot.PUBLIC_GAINS`: policies for the pushes and falling masses of
table 4, which the asset's stiffer motors hardly feel. Its soft motors sag, so the trunk's height has the weight
``HEIGHT`` of :mod:`paper.study.plan`: with the usual one, one policy of three walks at 0.28 m and misses the gate."""

USUAL_HEIGHT = "public_gains_usual_height"
"""As :data:`PUBLIC`, with the weight of the trunk's height that all other trainings have: how deep a pushed robot falls
is that weight's doing."""

EXPLICIT = "mr_go_sal_explicit"
"""MR_Go-SAL whose devices act by the paper's explicit torque (eqs. 6, 19) instead of a brake that sticks; otherwise
trained as the robots of tables 6 and 7."""

PAYING = (*ROBOTS, EXPLICIT)
"""Robots that pay for power and carry loads: those of tables 6 and 7."""

TRAINABLE = (*PLANTS, PUBLIC, USUAL_HEIGHT, *PAYING)
"""Everything that :func:`paper.study.plan.plant_cfg` knows."""
