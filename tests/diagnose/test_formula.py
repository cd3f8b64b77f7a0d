"""Formulas for unexplained structure: found again by their values, none where there is none."""

import re

import numpy as np
import pytest

from mrwarp.diagnose.formula import find_formula
from mrwarp.diagnose.result import Traces
from mrwarp.sysid.verdict import Unexplained

N = 20_000
K = np.arange(N)
Q, QD = 0.2 + 0.5 * np.sin(0.01 * K), 3.0 * np.cos(0.0131 * K)
UNITS = {"q": "rad", "current": "A", "torque": "N·m"}


def found(left: np.ndarray, along: tuple[str, ...] = ("q", "qd"), noise: float = 0.05) -> str | None:
    """Formula for a mismatch with noise."""
    zero = np.zeros(N)
    traces = Traces(
        torque=left + np.random.default_rng(0).normal(0.0, noise, N),
        baseline=zero,
        extended=zero,
        q=Q,
        qd=QD,
        qdd=zero,
        current=zero,
        time=zero,
        start=np.array([0, N]),
        regime=zero,
        noise_rms=noise,
    )
    return find_formula(traces, Unexplained(depends_on=along, form="product", share=0.5), UNITS, 0.6)


def value(text: str) -> np.ndarray:
    """Values of a formula along the motion; its variables as it defines them."""
    body, scales = re.fullmatch(r"\((.*)\) N·m with (.*)", text).groups()  # pyright: ignore[reportOptionalMemberAccess]
    names = {"q": Q, "qd": QD, "sin": np.sin, "cos": np.cos}
    for part in scales.split(", "):
        letter, expression = part.split(" = ")
        plain = re.sub(r" rad(/s)?", "", expression).replace("−", "-")
        names[letter] = eval(plain, {}, names)
    body = re.sub(r"\|(\w)\|", r"abs(\1)", body).replace("·", "*").replace("^", "**")
    return np.broadcast_to(eval(body, {}, names), N)


LAWS = {
    "product": lambda q, qd: 0.8 * q**2 * qd - 0.25 * qd,
    "modulus": lambda q, qd: 0.4 * q * np.abs(qd),
    "wave": lambda q, qd: 0.2 * np.sin(3.0 * q),
    "wave between the library's": lambda q, qd: 0.2 * np.sin(4.7 * q + 0.4),
    "wave that grows": lambda q, qd: 0.2 * np.sin(4.0 * q) * qd,
}


@pytest.mark.parametrize("law", LAWS.values(), ids=LAWS.keys())
def test_law_is_found_again(law) -> None:
    """Within a tenth of its own size, from cell means under noise."""
    left = law((Q - 0.2) / 0.5, QD / 3.0)
    text = found(left)
    assert text is not None
    inside = np.abs(Q - 0.2) < 0.48
    error = (value(text) - left)[inside]
    assert error.std() < 0.1 * left.std(), text


def test_noise_has_no_formula() -> None:
    """Cell means of noise alone."""
    assert found(np.zeros(N)) is None


def test_memory_and_lines_have_no_formula() -> None:
    """A torque that is no function of the moment."""
    assert found(0.5 * QD, ("memory",)) is None and found(0.5 * QD, ("frequency",)) is None
