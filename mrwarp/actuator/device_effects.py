"""The effects of one device in the simulator: which act, their row of values, the inertia they add, in words.

Effects of the kind ``mechanism`` are part of the device and act. Those of the kinds ``sensor`` and ``calibration`` are
properties of the bench's log, so they do not act on a robot; nor does an effect that the catalogue does not know. An
inertia acts as armature of the joint, in the model and so implicitly, never as a torque.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence

import numpy as np

from mrwarp.effects.catalogue import CATALOGUE, COLUMN, NULLS, column_of
from mrwarp.effects.law import EffectLaw
from mrwarp.model_file import Effect, key_shown

INERTIA = "rotor_inertia"
"""The effect that acts as armature."""


def acts(effect: Effect) -> bool:
    """Whether an effect is part of the device."""
    return effect.name in CATALOGUE and CATALOGUE[effect.name].kind == "mechanism"


def in_kernels(effects: Iterable[Effect]) -> bool:
    """Whether one of the effects needs the kernels with effects."""
    return any(acts(effect) and effect.name != INERTIA for effect in effects)


def silent_note(effects: Iterable[Effect]) -> str:
    """One line that names the effects that do not act and why; empty if all do."""
    found: dict[str, list[str]] = {}
    for effect in effects:
        if effect.name not in CATALOGUE:
            found.setdefault("unknown to the catalogue of effects", []).append(key_shown(effect.name))
        elif not acts(effect):
            found.setdefault("of the bench's log, not of the device", []).append(effect.name)
    parts = [f"{', '.join(names)} ({reason})" for reason, names in found.items()]
    return f"does not act in the simulator: {'; '.join(parts)}" if parts else ""


def effect_text(effect: Effect) -> str:
    """An effect with its numbers, on one line."""
    parts = []
    for name, p in effect.parameters.items():
        interval = f", 95 % interval {p.ci95[0]!r} to {p.ci95[1]!r}" if p.ci95 else ""
        unit = f" {key_shown(p.unit)}" if p.unit not in ("", "1") else ""
        parts.append(f"{key_shown(name)} = {p.value!r}{unit}{interval}")
    return f"{key_shown(effect.name)}{': ' if parts else ''}{'; '.join(parts)}"


def values_row(effects: Sequence[Effect], kinds: Sequence[str] = ("mechanism",)) -> np.ndarray:
    """Row of the catalogue's parameters for the kernels, those of absent effects at null, float64, shape (COLUMNS,).

    Args:
        effects: Checked effects, see :mod:`mrwarp.effects.model_entries`.
        kinds: Kinds that act. An inertia is left out, see :func:`added_inertia`.
    """
    row = np.array(NULLS, dtype=float)
    for effect, law in _of_kinds(effects, kinds):
        for k, spec in enumerate(law.parameters):
            given = effect.parameters.get(spec.name)
            row[COLUMN[law.name] + k] = given.value if given else (*spec.choices, spec.null)[0]
    return row


def values_range(effects: Sequence[Effect]) -> tuple[np.ndarray, np.ndarray]:
    """Rows of lower and upper ends of the parameters' intervals, both of shape (COLUMNS,).

    A parameter without interval has its value at both ends; an end that makes no sense for the law (a negative lag)
    gives way to the nearest one that does.
    """
    low, high = values_row(effects), values_row(effects)
    for effect, law in _of_kinds(effects, ("mechanism",)):
        for spec in law.parameters:
            given = effect.parameters.get(spec.name)
            if given is not None and given.ci95 is not None:
                at = column_of(law.name, spec.name)
                low[at], high[at] = given.ci95
                if not spec.allows(low[at]):
                    low[at] = min(1e-3 * given.value, high[at]) if spec.divides else 0.0
    return low, high


def added_inertia(effects: Sequence[Effect]) -> float:
    """Armature that the effects add to the joint [kg·m²]."""
    return sum(effect.values["inertia"] for effect in effects if effect.name == INERTIA)


def inertia_range(effects: Sequence[Effect]) -> tuple[float, float]:
    """Ends of the interval of :func:`added_inertia` [kg·m²]."""
    ends = [p.ci95 or (p.value, p.value) for e in effects if e.name == INERTIA for p in [e.parameters["inertia"]]]
    return sum(low for low, _ in ends), sum(high for _, high in ends)


def _of_kinds(effects: Sequence[Effect], kinds: Sequence[str]) -> list[tuple[Effect, EffectLaw]]:
    known = [(effect, CATALOGUE[effect.name]) for effect in effects if effect.name in CATALOGUE]
    return [(effect, law) for effect, law in known if law.kind in kinds and law.name != INERTIA]
