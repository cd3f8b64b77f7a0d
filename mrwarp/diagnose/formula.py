"""A formula for structure that no effect of the catalogue explains, by symbolic regression.

Needs the optional package gplearn (``pip install 'mrwarp[formula]'``). Its programs of the cell means of the mismatch
give the terms; their coefficients are then fitted again, and only terms that the cells speak for stay.
"""

from __future__ import annotations

import operator
import re
from collections.abc import Mapping
from itertools import combinations_with_replacement

import numpy as np

from mrwarp.diagnose.result import Traces, Unexplained

_CELLS = {1: 60, 2: 18, 3: 8}
"""Cells along each variable, by the number of variables."""
_LEAST = 20
"""Fewest samples of a cell that counts."""
_TERMS = 4
"""Most terms of a formula."""
_EXPLAINED = 0.6
"""Part of the variance of the cell means, beyond noise, that a formula must explain to be reported."""
_LETTERS = "xyz"
_SYMBOLS = {"q": "q", "qd": "qd", "qdd": "qdd", "current": "I", "time": "t"}
"""Variables that have a place in a formula."""


def find_formula(
    traces: Traces, unexplained: Unexplained, units: Mapping[str, str], *, seed: int = 0, population: int = 400
) -> str | None:
    """A formula for what an extended model leaves.

    Args:
        traces: Measured and simulated torque with the motion.
        unexplained: Says along which variables the structure lies.
        units: Units of the recording.
        seed: Of the search.
        population: Programs of a generation.

    Returns:
        The formula with units, or None: without the package, along memory or frequency, or where none fits.
    """
    names = [v for v in unexplained.depends_on if v in _SYMBOLS][:3]
    if not names or "frequency" in unexplained.depends_on:
        return None
    try:
        from gplearn.genetic import SymbolicRegressor
    except ImportError:
        return None
    import sympy

    values = np.stack([getattr(traces, name) for name in names])
    centre, half = _range(values)
    cells, mean, weight = _cell_means((values - centre) / half, traces.torque - traces.extended)
    if len(mean) < 12 or float(weight @ mean**2) <= 0.0:
        return None
    mean = mean - np.average(mean, weights=weight)
    size = float(np.sqrt(np.average(mean**2, weights=weight)))
    search = SymbolicRegressor(
        population_size=population,
        generations=12,
        function_set=("add", "sub", "mul", "abs", "sin"),
        metric="mse",
        parsimony_coefficient=0.003,
        const_range=(-2.0, 2.0),
        init_depth=(2, 4),
        random_state=seed,
    )
    search.fit(cells, mean / size, sample_weight=weight / weight.mean())
    symbols = [sympy.Symbol(letter, real=True) for letter in _LETTERS[: len(names)]]
    terms = _terms(search._programs[-1], symbols)
    chosen, coefficients, explained = _selected(terms, symbols, cells, mean, weight)
    noise = traces.noise_rms**2 * len(mean) / float(weight.sum())
    if explained * size**2 < _EXPLAINED * max(size**2 - noise, 1e-300):
        return None
    text = " ".join(f"{c:+.3g}·{_written(term)}" for c, term in zip(coefficients, chosen, strict=True))
    scales = []
    for name, letter, c, h in zip(names, _LETTERS, centre[:, 0], half[:, 0], strict=False):
        middle = f"({_SYMBOLS[name]} − {c:.3g} {_unit(name, units)})" if abs(c) > 0.01 * h else _SYMBOLS[name]
        scales.append(f"{letter} = {middle}/({h:.3g} {_unit(name, units)})".replace("− -", "+ "))
    constant = -float(np.average(_columns(chosen, symbols, cells) @ coefficients, weights=weight))
    if abs(constant) > 0.02 * size:
        text += f" {constant:+.3g}"
    return f"({text.removeprefix('+')}) {units['torque']} with {', '.join(scales)}"


def _range(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Middle and half of the bulk of each variable, shape (V, 1) each."""
    low, high = np.quantile(values, (0.01, 0.99), axis=1, keepdims=True)
    return 0.5 * (low + high), np.maximum(0.5 * (high - low), 1e-12)


def _cell_means(values: np.ndarray, mismatch: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Mean variables (C, V), mean mismatch (C,) and samples (C,) of the cells inside the bulk."""
    count = _CELLS[len(values)]
    inside = (np.abs(values) <= 1.0).all(axis=0)
    v, m = values[:, inside], mismatch[inside]
    index = np.zeros(v.shape[1], dtype=int)
    for x in v:
        index = index * count + np.clip(((x + 1.0) * 0.5 * count).astype(int), 0, count - 1)
    _, cell, samples = np.unique(index, return_inverse=True, return_counts=True)
    mean = np.bincount(cell, weights=m) / samples
    place = np.stack([np.bincount(cell, weights=x) / samples for x in v], axis=1)
    use = samples >= _LEAST
    return place[use], mean[use], samples[use].astype(float)


def _terms(programs: list, symbols: list) -> list:
    """Products that the best programs of a generation add up, without their coefficients."""
    import sympy

    found: dict = dict.fromkeys(_monomials(symbols))
    for program in sorted(programs, key=lambda p: p.fitness_)[:12]:
        for term in sympy.Add.make_args(sympy.expand(_expression(program.program, symbols))):
            _, product = term.as_coeff_Mul()
            if product.free_symbols:
                found[product] = None
    return list(found)


def _monomials(symbols: list) -> list:
    """Products of up to three variables, one of which may be an absolute value: simple terms are always looked at."""
    import sympy

    atoms = [*symbols, *(sympy.Abs(x) for x in symbols)]
    products = (sympy.Mul(*some) for size in (1, 2, 3) for some in combinations_with_replacement(atoms, size))
    return list(dict.fromkeys(products))


def _expression(nodes: list, symbols: list):
    """Expression of a program: its functions, variables (by number) and constants in prefix order."""
    import sympy

    functions = {"add": operator.add, "sub": operator.sub, "mul": operator.mul, "abs": sympy.Abs, "sin": sympy.sin}
    stack: list = []
    for node in reversed(nodes):
        if hasattr(node, "arity"):
            stack.append(functions[node.name](*(stack.pop() for _ in range(node.arity))))
        else:
            stack.append(symbols[node] if isinstance(node, int) else round(float(node), 3))
    return stack[0]


def _columns(terms: list, symbols: list, cells: np.ndarray) -> np.ndarray:
    import sympy

    columns = [np.broadcast_to(sympy.lambdify(symbols, t, "numpy")(*cells.T), len(cells)) for t in terms]
    return np.stack(columns, axis=1).astype(float)


def _selected(terms: list, symbols: list, cells: np.ndarray, mean: np.ndarray, weight: np.ndarray):
    """Terms that the cells speak for, one by one the best, their coefficients and what they explain of the variance."""
    root = np.sqrt(weight / weight.sum())
    table = _columns(terms, symbols, cells)
    table = (table - weight @ table / weight.sum()) * root[:, None]
    target, chosen, solution = mean * root, [], np.zeros(0)
    left = total = float(target @ target)
    while len(chosen) < min(_TERMS, len(terms)):
        trials = []
        for k in range(len(terms)):
            if k not in chosen:
                use = table[:, [*chosen, k]]
                x = np.linalg.lstsq(use, target, rcond=1e-8)[0]
                trials.append((float(((target - use @ x) ** 2).sum()), k, x))
        best = min(trials, key=lambda t: t[0] * (1.0 + 0.05 * terms[t[1]].count_ops()))
        if best[0] > left * (1.0 - 0.1) or left < 0.01 * total:
            break
        left, solution = best[0], best[2]
        chosen.append(best[1])
    for k in list(chosen):  # an early term may have become idle beside later ones
        rest = [j for j in chosen if j != k]
        x = np.linalg.lstsq(table[:, rest], target, rcond=1e-8)[0]
        without = float(((target - table[:, rest] @ x) ** 2).sum())
        if rest and without < left + 0.01 * total:
            chosen, solution, left = rest, x, without
    return [terms[k] for k in chosen], solution, 1.0 - left / total


def _written(term) -> str:
    """A product as an engineer writes it."""
    short = re.sub(r"\d+\.\d{3,}", lambda m: f"{float(m.group()):.3g}", str(term))
    return re.sub(r"Abs\((\w+)\)", r"|\1|", short).replace("**", "^").replace("*", "·")


def _unit(name: str, units: Mapping[str, str]) -> str:
    q = units.get("q", "rad")
    return {"q": q, "qd": f"{q}/s", "qdd": f"{q}/s²", "current": units.get("current", "A"), "time": "s"}[name]
