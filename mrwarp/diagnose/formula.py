"""A formula for structure that no effect of the catalogue explains: a few terms of a library, by stepwise regression.

The library holds products of the variables and their absolute values, waves along each, and waves times another
variable. Terms are fitted to the cell means of the mismatch, and only those that the cells speak for stay.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Mapping
from itertools import combinations_with_replacement

import numpy as np

from mrwarp.diagnose.result import Traces
from mrwarp.sysid.verdict import Unexplained

_CELLS = {1: 60, 2: 18, 3: 8}
"""Cells along each variable, by the number of variables."""
_LEAST = 20
"""Fewest samples of a cell that counts."""
_TERMS = 4
"""Most terms of a formula."""
_WAVES = np.arange(0.5, 12.1, 0.25)
"""Waves along a variable: angular frequencies per half of its range."""
_SYMBOLS = {"q": "q", "qd": "qd", "qdd": "qdd", "current": "I", "time": "t"}
"""Variables that have a place in a formula."""


def find_formula(traces: Traces, unexplained: Unexplained, units: Mapping[str, str], least: float) -> str | None:
    """A formula, with units, for what an extended model leaves; None along memory or frequency, or where none fits.

    It has to explain the part ``least`` of the cell means' variance beyond noise.
    """
    names = [v for v in unexplained.depends_on if v in _SYMBOLS][:3]
    if not names or "frequency" in unexplained.depends_on:
        return None
    values = np.stack([getattr(traces, name) for name in names])
    low, high = np.quantile(values, (0.01, 0.99), axis=1, keepdims=True)
    centre, half = 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-12)
    at = slice(None) if traces.counts is None else traces.counts
    cells, mean, weight = _cell_means((values[:, at] - centre) / half, (traces.torque - traces.extended)[at])
    if len(mean) < 12 or float(weight @ mean**2) <= 0.0:
        return None
    mean = mean - np.average(mean, weights=weight)
    square = float(np.average(mean**2, weights=weight))
    library = _library(cells)
    chosen, explained = _selected(library, mean, weight)
    noise = traces.noise_rms**2 * len(mean) / float(weight.sum())
    if explained * square < least * max(square - noise, 1e-300):
        return None
    text = " ".join(f"{factor:+.3g}·{term}" for term, factor in chosen.items())
    constant = -sum(factor * float(np.average(library[term], weights=weight)) for term, factor in chosen.items())
    if abs(constant) > 0.02 * np.sqrt(square):
        text += f" {constant:+.3g}"
    q, scales = units["q"], []
    unit = {"q": q, "qd": f"{q}/s", "qdd": f"{q}/s²", "current": units["current"], "time": "s"}
    for name, letter, c, h in zip(names, "xyz", centre[:, 0], half[:, 0], strict=False):
        middle = f"({_SYMBOLS[name]} − {c:.3g} {unit[name]})" if abs(c) > 0.01 * h else _SYMBOLS[name]
        scales.append(f"{letter} = {middle}/({h:.3g} {unit[name]})".replace("− -", "+ "))
    return f"({text.removeprefix('+')}) {units['torque']} with {', '.join(scales)}"


def _cell_means(values: np.ndarray, mismatch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean variables (V, C), mean mismatch (C,) and samples (C,) of the cells with all variables in -1 to 1."""
    count = _CELLS[len(values)]
    inside = (np.abs(values) <= 1.0).all(axis=0)
    v, m = values[:, inside], mismatch[inside]
    index = np.zeros(v.shape[1], dtype=int)
    for x in v:
        index = index * count + np.clip(((x + 1.0) * 0.5 * count).astype(int), 0, count - 1)
    _, cell, samples = np.unique(index, return_inverse=True, return_counts=True)
    use = samples >= _LEAST
    means = np.stack([np.bincount(cell, weights=x) / samples for x in (*v, m)])[:, use]
    return means[:-1], means[-1], samples[use].astype(float)


def _library(cells: np.ndarray) -> dict[str, np.ndarray]:
    """Every term by its text, in the order of their size; ``cells`` holds the variables, shape (V, C)."""
    plain = dict(zip("xyz", cells, strict=False))
    factors = plain | {f"|{letter}|": np.abs(x) for letter, x in plain.items()}
    waves = {
        f"{f.__name__}({k:g}·{letter})": f(k * x)
        for letter, x in plain.items()
        for k in _WAVES
        for f in (np.sin, np.cos)
    }
    found = {}
    for size in (1, 2, 3):
        for some in combinations_with_replacement(factors, size):
            text = "·".join(name if power == 1 else f"{name}^{power}" for name, power in Counter(some).items())
            found[text] = np.prod([factors[name] for name in some], axis=0)
    mixed = {
        f"{name}·{letter}": wave * x
        for name, wave in waves.items()
        for letter, x in plain.items()
        if letter not in name
    }
    return found | waves | mixed


def _selected(
    library: Mapping[str, np.ndarray], mean: np.ndarray, weight: np.ndarray
) -> tuple[dict[str, float], float]:
    """Terms that the cells speak for, one by one the best, their factors and the part of the variance they explain."""
    root = np.sqrt(weight / weight.sum())
    table = {term: (x - np.average(x, weights=weight)) * root for term, x in library.items()}
    target = mean * root
    left = total = float(target @ target)

    def fitted(terms: list[str]) -> tuple[float, np.ndarray]:
        """Rest of the mean square after terms, and their factors."""
        use = np.stack([table[term] for term in terms], axis=1)
        factors = np.linalg.lstsq(use, target, rcond=1e-8)[0]
        return float(((target - use @ factors) ** 2).sum()), factors

    chosen: list[str] = []
    while len(chosen) < _TERMS and left >= 0.01 * total:
        trials = {term: fitted([*chosen, term])[0] for term in table if term not in chosen}
        best = min(trials, key=lambda term: trials[term] * (1.0 + 0.05 * (term.count("·") + term.count("^"))))
        if trials[best] > 0.9 * left:
            break
        left = trials[best]
        chosen.append(best)
    for term in list(chosen):  # an early term may have become idle next to later ones
        rest = [other for other in chosen if other != term]
        if rest and fitted(rest)[0] < left + 0.01 * total:
            chosen, left = rest, fitted(rest)[0]
    factors = fitted(chosen)[1].tolist() if chosen else []
    return dict(zip(chosen, factors, strict=True)), 1.0 - left / total
