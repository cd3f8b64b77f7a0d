"""Replay kernel: equals an independent simulation, the actuator's own laws, and itself alone."""

import numpy as np
import pytest

from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.identify.replay import Replay

PAPER = {
    "D": -0.01917639, "B": 0.1013626, "C": 0.2160456, "I1": -7.681742e-4, "K0": 0.3992754, "K1": 10.413315,
    "alpha": 0.7777051, "beta": 16.50618, "gamma": -10.53036, "z_max": 5.0, "q_neutral": -1.5, "q_offset": 0.01,
}  # fmt: skip
EPS = float(np.finfo(np.float32).eps)
LENGTHS, STEPS = (300, 170, 61), (0.005, 0.001, 0.01)


def motion(seed: int = 3) -> dict[str, np.ndarray]:
    """Three trajectories of different lengths and steps end to end."""
    rng = np.random.default_rng(seed)
    parts = [
        (np.arange(n) * dt, rng.uniform(1, 6), rng.uniform(0.2, 0.6)) for n, dt in zip(LENGTHS, STEPS, strict=True)
    ]
    return {
        "q": np.concatenate([a * np.sin(w * t) - 1.5 for t, w, a in parts]),
        "qd": np.concatenate([a * w * np.cos(w * t) for t, w, a in parts]),
        "current": np.concatenate([np.where(np.sin(3 * t + w) > 0, 1.0, 0.3) for t, w, _ in parts]),
    }


def launch(candidates: list[dict], data: dict, *, exact: int = 1, substeps: int = 0) -> np.ndarray:
    """Torque of all candidates, shape (C, N)."""
    start = np.concatenate([[0], np.cumsum(LENGTHS)])
    samples = Dataset(
        q=data["q"],
        qd=data["qd"],
        current=data["current"],
        torque=np.zeros(len(data["q"])),
        start=start,
        dt=np.array(STEPS),
        scales=Scales(),
    )
    return Replay(samples, exact=bool(exact), substeps=substeps).torque(candidates)


def reference(p: dict, data: dict, lag: float = 0.0) -> np.ndarray:
    """Eqs. 14 and 15 in float64 with the paper's Euler step, trajectory by trajectory."""
    tau, at = [], 0
    for n, dt in zip(LENGTHS, STEPS, strict=True):
        z, current = 0.0, data["current"][at]
        for k in range(at, at + n):
            qd, q_c = data["qd"][k], data["q"][k] - p["q_neutral"] - p["q_offset"]
            command, begin = data["current"][k], current
            current = command + (begin - command) * (np.exp(-dt / lag) if lag else 0.0)
            mean = command + (begin - command) * (lag / dt * (1.0 - np.exp(-dt / lag)) if lag else 0.0)
            z += dt * (qd - p["beta"] * abs(qd) * z - p["gamma"] * qd * abs(z))
            gain = (p["K0"] + p["K1"] * mean) / (1 + p["alpha"] * abs(qd))
            tau.append(p["D"] + p["B"] * qd + p["C"] * q_c + p["I1"] * mean + gain * z)
        at += n
    return np.array(tau)


@pytest.mark.parametrize("lag", [0.0, 0.012])
def test_euler_replay_equals_numpy(lag: float) -> None:
    """The simulator's Euler step, with and without coil lag, equals a float64 loop; errors decay along the path."""
    data = motion()
    tau = launch([PAPER | {"coil_time_constant": lag}], data, exact=0)[0]
    # torque up to 3 N·m of a contracting state: a few dozen roundings of float32
    np.testing.assert_allclose(tau, reference(PAPER, data, lag), rtol=0, atol=40 * EPS * 3.0)


def test_coil_of_a_recorded_command_answers_from_its_sample() -> None:
    """A step of the command at a sample reaches a bench's torque as 1 - exp(-t/T) from there, not a sample early."""
    lag, data = 0.012, {"q": np.zeros(sum(LENGTHS)), "qd": np.zeros(sum(LENGTHS)), "current": np.zeros(sum(LENGTHS))}
    at = np.concatenate([np.arange(n) for n in LENGTHS])
    dt = np.repeat(STEPS, LENGTHS)
    data["current"] = np.where(at >= 10, 1.0, 0.0)
    tau = launch([{"I1": 1.0, "coil_time_constant": lag}], data, substeps=2)[0]
    want = 1.0 - np.exp(-np.maximum(at - 10, 0) * dt / lag)
    np.testing.assert_allclose(tau, want, rtol=0, atol=20 * EPS)


def test_substeps_converge_at_second_order() -> None:
    """Parts are midpoints of an interpolated velocity: two for one at least thirds the error, down to float32."""
    data = motion(6)
    fine = launch([PAPER], data, substeps=256)[0]
    errors = [np.sqrt(np.mean((launch([PAPER], data, substeps=n)[0] - fine) ** 2)) for n in (1, 2)]
    assert errors[0] > 3.0 * errors[1]
    assert errors[1] < 5e-5  # N·m, the default's own discretisation, against a torque of 2 N·m


def test_velocity_between_is_exact_for_a_parabola() -> None:
    """The cubic through four samples of v(t) = 1 + 2t - 3t^2 gives v between them, and the samples at the ends."""
    data = {"q": np.zeros(531), "current": np.zeros(531), "qd": np.zeros(531)}
    t = np.concatenate([np.arange(n) * 0.01 for n in LENGTHS])
    data["qd"] = 1.0 + 2.0 * t - 3.0 * t**2
    # K0 = 1 with beta = 1e-6 makes z the path: its increments are the midpoint values themselves
    z = launch([{"K0": 1.0, "beta": 1e-6}], data, substeps=1)[0].astype(float)
    inner = np.arange(2, 20)
    middle = t[inner] - 0.005
    want = (1.0 + 2.0 * middle - 3.0 * middle**2) * STEPS[0]
    np.testing.assert_allclose(z[inner] - z[inner - 1], want, rtol=0, atol=8 * EPS * z[20])


def catmull_rom(v: np.ndarray, first: int, last: int, k: int, part: float) -> float:
    """Velocity between samples k - 1 and k from the Hermite form, the tangents being central differences."""
    a, b, c, d = v[max(k - 2, first)], v[k - 1], v[k], v[min(k + 1, last)]
    h00, h10 = 2 * part**3 - 3 * part**2 + 1, part**3 - 2 * part**2 + part
    h01, h11 = -2 * part**3 + 3 * part**2, part**3 - part**2
    return h00 * b + h10 * (c - a) / 2 + h01 * c + h11 * (d - b) / 2


def test_extension_equals_numpy() -> None:
    """Saturation, softening and creep follow their differential equation, solved in float64 with 200 parts per step."""
    data, extra = motion(7), {"saturation": 1.3, "softening": 0.8, "creep": 6.0}
    tau = launch([PAPER | extra], data, substeps=8)[0]
    want, at, parts = [], 0, 200
    for n, dt in zip(LENGTHS, STEPS, strict=True):
        z = 0.0
        for k in range(at, at + n):
            u = (1 - np.exp(-1.3 * data["current"][k])) / (1 - np.exp(-1.3))
            soft = np.exp(0.8 * (1 - u))
            for i in range(parts if k > at else 0):
                qd = catmull_rom(data["qd"], at, at + n - 1, k, (i + 0.5) / parts)
                rate = qd - soft * (PAPER["beta"] * abs(qd) * z + PAPER["gamma"] * qd * abs(z)) - 6.0 * z
                z += dt / parts * rate
            qd, q_c = data["qd"][k], data["q"][k] - PAPER["q_neutral"] - PAPER["q_offset"]
            gain = (PAPER["K0"] + PAPER["K1"] * u) / (1 + PAPER["alpha"] * abs(qd))
            want.append(PAPER["D"] + PAPER["B"] * qd + PAPER["C"] * q_c + PAPER["I1"] * u + gain * z)
        at += n
    # both discretise: the reference to first order in dt/200 (rate 60/s: 0.01/200*60 = 0.3 % of 2 N·m at worst)
    np.testing.assert_allclose(tau, want, rtol=0, atol=6e-3)


def test_null_extension_changes_no_bit() -> None:
    """All-zero extension is the simulator's law: a vanishing softening differs, zero does not call the other branch."""
    data = motion()
    plain = launch([PAPER], data, substeps=1)[0]
    null = launch([PAPER | {"saturation": 0.0, "softening": 0.0, "creep": 0.0}], data, substeps=1)[0]
    near = launch([PAPER | {"softening": 1e-7}], data, substeps=1)[0]
    np.testing.assert_array_equal(plain, null)
    np.testing.assert_allclose(plain, near, rtol=0, atol=40 * EPS * 3.0)
