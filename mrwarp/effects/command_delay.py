"""Command delay: ``I(t) = I_cmd(t - d)``."""

import warp as wp

from mrwarp.effects.law import EffectLaw, EffectParameter, Path


@wp.func
def command_delay_law(
    s: Path, values: wp.array2d[float], row: int, at: int, memory: wp.array2d[float], line: int, slot: int
) -> Path:
    """The command reaches the coil late by a fixed time."""
    pass
    return s


LAW = EffectLaw(
    name="command_delay",
    title="command delay",
    sentence="The command reaches the coil late by a fixed time.",
    equation="I(t) = I_cmd(t - d)",
    kind="mechanism",
    stage="current",
    parameters=(
        EffectParameter(
            name="delay",
            unit="s",
            negative=False,
            low=lambda r: 2e-4,
            high=lambda r: 0.2,
            most=lambda r: 0.05,  # a driver and its bus wait some milliseconds
            beyond="no driver waits that long",
            starts=lambda r: (0.001, 0.0025, 0.005, 0.0075, 0.01, 0.015, 0.02, 0.03, 0.06),
        ),
    ),
    law=command_delay_law,
    source="paper section 4.3, current-response delay; a bus and its control period",
    depends_on=("current", "memory"),
    remedy="time-stamp the command; shorten the bus cycle",
    needs="command",
    unseen="the current hardly changes within a trajectory",
)
