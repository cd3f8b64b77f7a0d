"""Extended physical model: what a real MR damper shows beyond eq. 14, identified by the same machinery.

``tau = D + C*q + I1*u + (B + B_current*u)*qd + (B_direction + B_direction_current*u)*|qd| + h``,
``h = (K0 + K1*u)/(1 + alpha*|qd|) * z``,
``dz/dt = qd - r(u)*(beta*|qd|*z + gamma*qd*|z|) - creep*z``,  ``r(u) = exp(softening*(1 - |u|/I_full))``

* current map ``u(I)``: the fluid saturates, ``u = I_full*(1 - exp(-saturation*I/I_full))/(1 - exp(-saturation))``;
* ``B_current``: viscosity grows with the current;
* ``B_direction*``: tension and compression differ;
* ``softening``: the yield travel grows with the current (something elastic in series);
* ``creep``: stress leaks away at rest, so slow motion meets little force (a leak past the valve).

Every law vanishes at 0. The learned residual is not part of it.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from mrwarp.identify.dataset import Dataset, Scales
from mrwarp.identify.fit import BoucWenStructure, summary
from mrwarp.identify.intervals import Estimate, assess
from mrwarp.identify.projection import Progress, search
from mrwarp.identify.replay import Replay
from mrwarp.recording.load import Recording

LINEAR = ("D", "B", "C", "I1", "K0", "K1", "B_current", "B_direction", "B_direction_current")
SHAPE = ("alpha", "beta", "gamma", "saturation", "softening", "creep")


class ExtendedStructure(BoucWenStructure):
    """Shape: that of eqs. 14 and 15, then log(saturation), softening, log(creep)."""

    shape = SHAPE
    linear = LINEAR

    def __init__(self, samples: Dataset) -> None:
        super().__init__(samples)
        self.low = np.append(self.low, [-3.0, -1.0, -4.0])
        self.high = np.append(self.high, [2.3, 6.0, 6.0])
        axes = ((0.1,), (2.5, 3.5, 4.5), (4.0, 5.5), (-0.5,), (0.0, 2.0), (1.0, 3.0))
        self.grid = tuple(np.array(axis) for axis in axes)

    def loop(self, theta: np.ndarray) -> dict[str, float]:
        """Parameters of the hysteresis element of a shape."""
        extra = {"saturation": np.exp(theta[3]), "softening": theta[4], "creep": np.exp(theta[5])}
        return super().loop(theta) | extra

    def elements(self, theta: np.ndarray) -> list[dict[str, float]]:
        """The hysteresis element of unit gain, and the current map."""
        return _elements(self.loop(theta))

    def columns(self, samples: Dataset, elements: np.ndarray, theta: np.ndarray) -> np.ndarray:
        """Torque per unit of each of :data:`LINEAR`."""
        return _columns(samples, elements)


@dataclass(frozen=True, kw_only=True)
class ExtendedFit:
    """A fitted extended model, in the units of the recording."""

    estimates: dict[str, Estimate]
    current_full: float
    """I_full of the current map: the largest current of the recording."""
    rmse: float
    nrmse: float
    rmse_per_trajectory: dict[str, float]
    rmse_per_current: dict[str, float]
    simulated: tuple[np.ndarray, ...]
    warnings: tuple[str, ...]

    @property
    def values(self) -> dict[str, float]:
        """All parameters, as :func:`extended_torque` wants them."""
        return {name: e.value for name, e in self.estimates.items()} | {"current_full": self.current_full}


def fit_extended(recording: Recording, *, seed: int = 0, progress: Progress | None = None) -> ExtendedFit:
    """Identify the extended model; needs at least two levels of current.

    Args:
        recording: Measured runs.
        seed: As in :func:`mrwarp.identify.fit.fit`.
        progress: Called with what is being done.
    """
    scales = Scales.of(recording)
    samples = Dataset.of(recording, scales)
    structure, replay = ExtendedStructure(samples), Replay(samples)
    point, warnings = search(structure, replay, seed=seed, log=progress or (lambda text: None))

    def named(x: np.ndarray) -> dict[str, float]:
        inner = dict(zip(LINEAR, x, strict=False)) | structure.loop(x[len(LINEAR) :])
        return {name: float(value) * scales.factor(name) for name, value in inner.items()}

    names = LINEAR + SHAPE
    assessment = assess(point, named, len(names), names)
    warnings += [f"cannot be told apart: {', '.join(group)}" for group in assessment.together]
    tau = point.simulated * scales.torque
    figures = summary(recording, [tau[part] for part in samples.parts])
    kept = {f.name: figures[f.name] for f in dataclasses.fields(ExtendedFit) if f.name in figures}
    return ExtendedFit(estimates=assessment.estimates, current_full=scales.current, warnings=tuple(warnings), **kept)


def extended_torque(values: Mapping[str, float], recording: Recording) -> list[np.ndarray]:
    """Torque of the extended model along each trajectory [unit of the recording].

    Args:
        values: As :attr:`ExtendedFit.values`.
        recording: The motion; its measured torque is not used but for the inner scale.
    """
    scales = dataclasses.replace(Scales.of(recording), current=values["current_full"])
    samples = Dataset.of(recording, scales)
    inner = {name: values[name] / scales.factor(name) for name in LINEAR + SHAPE}
    elements = Replay(samples).torque(_elements({name: inner[name] for name in SHAPE}))
    tau = _columns(samples, elements) @ np.array([inner[name] for name in LINEAR]) * scales.torque
    return [tau[part] for part in samples.parts]


def moving_average(x: np.ndarray, samples: int) -> np.ndarray:
    """Centred moving average, the ends held."""
    padded = np.pad(x, (samples // 2, samples - 1 - samples // 2), mode="edge")
    sums = np.cumsum(np.concatenate([[0.0], padded]))
    return (sums[samples:] - sums[:-samples]) / samples


def undo_moving_average(recording: Recording, window: float, *, floor: float = 0.01) -> Recording:
    """The recording with the motion it had before ``q`` passed a centred moving average of ``window`` [s].

    The average multiplies the spectrum by ``H(f) = sin(pi*f*window)/(pi*f*window)``; it is divided out by
    ``H/(H^2 + floor^2)``, which leaves the lost bands around its zeros alone. Torque is neither touched nor
    used. For records that begin and end at rest.
    """
    runs = []
    for run in recording.trajectories:
        count, size = _samples_in(window, run.dt), len(run.q)
        pad = 10 * count
        q = np.pad(run.q, pad, mode="edge")
        kernel = np.zeros(len(q))
        kernel[:count] = 1.0 / count
        h = np.fft.rfft(np.roll(kernel, -(count // 2)))
        q = np.fft.irfft(np.fft.rfft(q) * np.conj(h) / (np.abs(h) ** 2 + floor**2), len(q))[pad : pad + size]
        runs.append(dataclasses.replace(run, q=q, qd=np.gradient(q, run.dt), qd_derived=True))
    return dataclasses.replace(recording, trajectories=tuple(runs))


def prediction_errors(recording: Recording, simulated: Sequence[np.ndarray], window: float = 0.0) -> dict[str, float]:
    """Root mean square error over standard deviation per trajectory.

    Where the measured torque passed a centred moving average of ``window`` [s], the simulated one passes the same, and
    both lose their mean, since such records come without one.
    """
    figures = {}
    for run, tau in zip(recording.trajectories, simulated, strict=True):
        error = tau - run.torque
        if window > 0.0:
            error = moving_average(tau, _samples_in(window, run.dt)) - run.torque
            error -= error.mean()
        figures[run.id] = float(np.sqrt(np.mean(error**2)) / (run.torque.std() or 1.0))
    return figures


def _samples_in(window: float, dt: float) -> int:
    """Samples that a moving average covers: one at least, which changes nothing."""
    return max(round(window / dt), 1)


def _elements(loop: Mapping[str, float]) -> list[dict[str, float]]:
    """Unit hysteresis element and unit current map, in normalised units."""
    return [{"K0": 1.0, **loop}, {"I1": 1.0, "saturation": loop["saturation"]}]


def _columns(samples: Dataset, elements: np.ndarray) -> np.ndarray:
    """Torque per unit of each of :data:`LINEAR`, shape (N, 9)."""
    h, u = elements.astype(float)
    qd, speed = samples.qd, np.abs(samples.qd)
    return np.column_stack([np.ones(len(h)), qd, samples.q, u, h, u * h, u * qd, speed, u * speed])
