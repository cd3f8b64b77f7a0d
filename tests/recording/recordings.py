"""Recordings as any logger writes them, for tests."""

from pathlib import Path

import numpy as np

DEG = 180.0 / np.pi
"""Degrees in a radian."""


def columns(n: int = 200, dt: float = 0.005) -> dict[str, np.ndarray]:
    """A plausible trajectory."""
    t = np.arange(n) * dt
    q, qd = 0.5 * np.sin(2 * np.pi * t), np.pi * np.cos(2 * np.pi * t)
    current = np.where(t < 0.5, 0.0, 1.0)
    return {"t": t, "q": q, "qd": qd, "current": current, "torque": (0.5 + 0.5 * current) * np.tanh(qd)}


def write(path: Path, data: dict[str, np.ndarray]) -> Path:
    """A CSV as any logger writes it."""
    rows = np.column_stack(list(data.values()))
    path.write_text(",".join(data) + "\n" + "\n".join(",".join(repr(float(x)) for x in row) for row in rows) + "\n")
    return path
