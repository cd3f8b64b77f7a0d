"""Bench-like recordings of a known joint by an independent simulation: classical Runge-Kutta in float64 at 2 kHz."""

import numpy as np

from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.recording.load import Recording, Trajectory

TRUTH = {
    "D": -0.01917639, "B": 0.1013626, "C": 0.2160456, "I1": -7.681742e-4, "K0": 0.3992754, "K1": 10.413315,
    "alpha": 0.7777051, "beta": 16.50618, "gamma": -10.53036,
}  # fmt: skip
"""Paper section 4.2."""

DT = 0.005
_SUB = 10


def hysteresis(qd: np.ndarray, h: float, beta: float, gamma: float) -> np.ndarray:
    """z of eq. 15 along fine samples of the velocity, shape (T, S), from z = 0."""
    out, z = np.zeros_like(qd), np.zeros(len(qd))

    def rate(v: np.ndarray, z: np.ndarray) -> np.ndarray:
        return v - beta * abs(v) * z - gamma * v * abs(z)

    for i in range(1, qd.shape[1]):
        before, after = qd[:, i - 1], qd[:, i]
        middle = 0.5 * (before + after)
        k1 = rate(before, z)
        k2 = rate(middle, z + 0.5 * h * k1)
        k3 = rate(middle, z + 0.5 * h * k2)
        k4 = rate(after, z + h * k3)
        z = z + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
        out[:, i] = z
    return out


def bench_like(seed: int, *, runs: int = 12, seconds: float = 4.0, noise: float = 1.0, p: dict = TRUTH) -> Recording:
    """Sums of sines of 0.5 to 2 Hz at 0, 0.5, 1, 1.5 A or stepped current, logged at 200 Hz.

    Noise as on a bench: white 0.02 and 50 ms coloured 0.01 N·m, per run 0.003 N·m zero error and 0.3 % gain, 0.3 mrad
    encoder steps, 0.01 rad/s on the velocity.
    """
    rng = np.random.default_rng(seed)
    samples = round(seconds / DT)
    h, fine = DT / _SUB, samples * _SUB
    t = np.arange(fine) * h
    q, current = np.zeros((runs, fine)), np.zeros((runs, fine))
    for k in range(runs):
        for _ in range(3):
            f, amplitude, phase = rng.uniform(0.5, 2.0), rng.uniform(0.1, 0.35), rng.uniform(0.0, 2.0 * np.pi)
            q[k] += amplitude * np.sin(2.0 * np.pi * f * t + phase)
        steps = np.repeat(rng.choice([0.0, 0.5, 1.0, 1.5], 8), -(-fine // 8))[:fine]
        current[k] = steps if k % 3 == 0 else (0.0, 0.5, 1.0, 1.5)[(k // 2) % 4]
    qd = np.gradient(q, h, axis=1)
    z = hysteresis(qd, h, p["beta"], p["gamma"])
    logged = np.stack([q, qd, current, z])[:, :, ::_SUB]
    q, qd, current, z = logged[0], logged[1], logged[2], logged[3]
    gain = (p["K0"] + p["K1"] * current) / (1.0 + p["alpha"] * abs(qd))
    torque = p["D"] + p["B"] * qd + p["C"] * q + p["I1"] * current + gain * z
    coloured, white = np.zeros((runs, samples)), rng.normal(size=(runs, samples))
    decay = np.exp(-DT / 0.05)
    for i in range(1, samples):
        coloured[:, i] = decay * coloured[:, i - 1] + np.sqrt(1.0 - decay**2) * white[:, i]
    torque = torque * (1.0 + 0.003 * noise * rng.normal(size=(runs, 1)))
    torque += noise * (0.02 * rng.normal(size=torque.shape) + 0.01 * coloured + 0.003 * rng.normal(size=(runs, 1)))
    qd = qd + 0.01 * noise * rng.normal(size=qd.shape)
    q = np.round(q / 3e-4) * 3e-4 if noise else q
    t = np.arange(samples) * DT
    return Recording(
        trajectories=tuple(
            Trajectory(id=f"run{k}", t=t, q=q[k], qd=qd[k], current=current[k], torque=torque[k]) for k in range(runs)
        )
    )


def scaled(recording: Recording, q: float, current: float, torque: float, units: dict[str, str]) -> Recording:
    """The runs of a device with other scales."""
    runs = tuple(
        Trajectory(id=r.id, t=r.t, q=r.q * q, qd=r.qd * q, current=r.current * current, torque=r.torque * torque)
        for r in recording.trajectories
    )
    return Recording(trajectories=runs, units=units)


def samples(lengths: list[int]) -> Dataset:
    """Trajectories of some lengths; only their bounds count here."""
    zero = np.zeros(sum(lengths))
    return Dataset(
        q=zero,
        qd=zero,
        current=zero,
        torque=zero,
        start=np.cumsum([0, *lengths]),
        dt=np.full(len(lengths), DT),
        scales=Scales(),
    )
