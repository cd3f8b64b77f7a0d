"""The effects of a batch of devices: their values and states as the kernels take them.

Effects of the kind ``mechanism`` act. An inertia acts as armature of the joint, in the model and so implicitly, never
as a torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import warp as wp

from mrwarp.effects.catalogue import COLUMN, COLUMNS, KNOWN, NULLS, SLOTS, column_of
from mrwarp.effects.step_kernel import EffectArrays, reset_effects_kernel
from mrwarp.kernels.mr_joint import JointParams
from mrwarp.model_file import Effect

INERTIA = "rotor_inertia"
"""The effect that acts as armature."""


def in_kernels(effects: Iterable[Effect]) -> bool:
    """Whether one of the effects needs the kernels with effects."""
    return any(effect.acts and effect.name != INERTIA for effect in effects)


def added_inertia(effects: Iterable[Effect]) -> float:
    """Armature that the effects add to the joint [kg·m²]."""
    return sum(effect.values["inertia"] for effect in effects if effect.name == INERTIA and effect.acts)


def values_row(effects: Iterable[Effect]) -> np.ndarray:
    """Row of the catalogue's parameters for the kernels, float64, shape (COLUMNS,).

    Parameters of effects that are absent or do not act in the kernels are at their null values.
    """
    row = np.array(NULLS, dtype=float)
    for effect in effects:
        if in_kernels([effect]):
            for k, spec in enumerate(KNOWN[effect.name].parameters):
                given = effect.parameters.get(spec.name)
                row[COLUMN[effect.name] + k] = given.value if given else (*spec.choices, spec.null)[0]
    return row


def longest_delay(effects: Iterable[Effect]) -> float:
    """Longest delay of the command [s]: the upper end of its interval, without one its value, without delay 0."""
    delays = [effect.parameters["delay"] for effect in effects if effect.name == "command_delay"]
    return max((p.ci95[1] if p.ci95 else p.value for p in delays), default=0.0)


class DeviceEffects:
    """Values and states of the effects of E x M devices.

    Args:
        effects: Checked effects of each device, length M.
        num_envs: Number of environments E.
        dt: Torque step [s].
        device: Warp device.
        rows: Rows of values: 1 for all environments, or E.

    Attributes:
        values: Parameters of all effects, those of absent ones at null, shape (1 or E, M, COLUMNS).
        memory: States of the effects, shape (E, M, SLOTS).
        commands: Past commands [A], shape (E, M, DEPTH).
        newest: Where the newest of them stands, shape (E, M).
        heat: Stored heat [J], shape (E, M).
        clock: Steps since the session began, shape (1,).
        params: The devices' parameters as the effects leave them in this step, shape (E, M).
        states: Those that go on from step to step, by name.
        arrays: All of them, as the kernels take them.
    """

    def __init__(
        self, effects: Sequence[Sequence[Effect]], *, num_envs: int, dt: float, device: Any, rows: int
    ) -> None:
        num_mr = len(effects)
        self.device, self.num_envs = device, num_envs
        nominal = np.stack([values_row(found) for found in effects])
        self.values = wp.array(np.tile(nominal, (rows, 1, 1)), dtype=float, device=device)
        depth = int(max(map(longest_delay, effects)) / dt) + 3  # one to spare for rounding to 32 bits
        shape = (num_envs, num_mr)
        self.states: dict[str, wp.array] = {}

        def state(name: str, *shape: int, dtype: type = float) -> wp.array:
            self.states[name] = wp.zeros(shape, dtype=dtype, device=device)
            return self.states[name]

        self.heat = state("heat", *shape)
        self.newest = state("newest", *shape, dtype=int)
        self.memory = state("memory", *shape, SLOTS)
        self.commands = state("commands", *shape, depth)
        self.clock = state("clock", 1, dtype=int)
        self.params = wp.zeros(shape, dtype=JointParams, device=device)  # pyright: ignore[reportArgumentType]
        self.arrays = EffectArrays()
        for name in ("heat", "newest", "clock", "params"):
            setattr(self.arrays, name, getattr(self, name))
        self.arrays.values = self.values.reshape((rows * num_mr, COLUMNS))
        self.arrays.memory = self.memory.reshape((num_envs * num_mr, SLOTS))
        self.arrays.commands = self.commands.reshape((num_envs * num_mr, depth))

    def value(self, effect: str, parameter: str) -> wp.array:
        """Live view of one parameter, shape (1 or E, M); writing to it changes the devices.

        A delay can be raised up to the largest that a device began with, or its interval's end.
        """
        view = self.values[:, :, column_of(effect, parameter)]
        assert isinstance(view, wp.array)  # one column
        return view

    def reset(self, mask: wp.array) -> None:
        """Masked devices are cold, without current and field; the session goes on. Others stay bit-equal."""
        wp.launch(reset_effects_kernel, dim=self.newest.shape, inputs=[mask], outputs=[self.arrays], device=self.device)

    def state(self) -> dict[str, np.ndarray]:
        """Copy of everything a resumed run needs, by name."""
        arrays = {**self.states, "values": self.values}
        return {f"effects_{name}": array.numpy().copy() for name, array in arrays.items()}

    def load_state(self, state: dict[str, np.ndarray]) -> None:
        """Restore :meth:`state`, bit-equal."""
        for name, array in (*self.states.items(), ("values", self.values)):
            array.assign(state[f"effects_{name}"])
