"""Sessions of the virtual bench with one effect each, by the law that the catalogue writes: sizes and intervals.

They show what estimation alone does to a size. The noise is that of a good stand (docs/diagnosis.md).
"""

from __future__ import annotations

from benchmarks.confusion.case import JointCase, Truth
from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, run_bench

STAND = {
    "run_bias": 0.003,
    "run_gain": 0.003,
    "torque_noise": 0.02,
    "coloured_noise": 0.01,
    "velocity_noise": 0.01,
    "encoder_step": 0.0003835,
}
"""Noise of a good stand."""

EFFECTS = {
    "coil_lag": (0.012, "time_constant", "s"),
    "command_delay": (0.0072, "delay", "s"),
    "torque_sensor_lag": (0.004, "time_constant", "s"),
    "velocity_lag": (0.004, "time_constant", "s"),
    "rotor_inertia": (0.002, "inertia", "kg·m²"),
    "coulomb_friction": (0.05, "torque", "N·m"),
    "friction_asymmetry": (0.05, "coulomb", "N·m"),
    "current_viscosity": (0.05, "B1", "N·m·s/(rad·A)"),
    "remanence": (0.03, "half_width", "A"),
    "backlash": (0.003, "half_gap", "rad"),
}
"""Size, parameter and unit of each effect that bench and catalogue write by the same law."""

SIZES = {"large": (32, 51_200), "small": (12, 9_600)}
"""Trajectories and samples of a session, by the name of the size."""


def make_session(kind: str, *, seed: int, size: str = "large") -> JointCase:
    """Run a session with this effect."""
    value, parameter, unit = EFFECTS[kind]
    trajectories, samples = SIZES[size]
    cfg = BenchCfg(
        effects=Effects({**STAND, kind: value}),
        trajectories=trajectories,
        samples=samples,
        evaluation_samples=0,
        seed=seed,
    )
    stated = {"parameter": parameter, "value": value, "unit": unit, "exact": True, "level": None, "draws": {}}
    truth = Truth(kinds=(kind,), background=(), parameters={kind: stated}, depends_on=frozenset(), base={})
    return JointCase(seed=seed, recording=run_bench(cfg).fit, truth=truth, level=0.0)
