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
from mrwarp.identify.fit import BoucWenStructure, Misfit, misfit
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

    def elements(self, loop: Mapping[str, float]) -> list[dict[str, float]]:
        """The hysteresis element of unit gain, and the unit current map."""
        return [{"K0": 1.0, **loop}, {"I1": 1.0, "saturation": loop["saturation"]}]

    def columns(self, samples: Dataset, elements: np.ndarray) -> np.ndarray:
        """Torque per unit of each of :data:`LINEAR`, shape (N, 9)."""
        h, u = elements.astype(float)
        qd, speed = samples.qd, np.abs(samples.qd)
        return np.column_stack([np.ones(len(h)), qd, samples.q, u, h, u * h, u * qd, speed, u * speed])


@dataclass(frozen=True, kw_only=True)
class ExtendedFit(Misfit):
    """A fitted extended model, in the units of the recording."""

    estimates: dict[str, Estimate]
    current_full: float
    """I_full of the current map: the largest current of the recording."""

    @property
    def values(self) -> dict[str, float]:
        """All parameters, as :func:`extended_torque` wants them."""
        return {name: e.value for name, e in self.estimates.items()} | {"current_full": self.current_full}


def fit_extended(recording: Recording, *, seed: int = 0, progress: Progress | None = None) -> ExtendedFit:
    """Identify the extended model; needs at least two levels of current.

    Args:
        recording: Measured runs.
        seed: Seed of the samples on which the starts are searched.
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
    warnings += [f"cannot be distinguished: {', '.join(group)}" for group in assessment.together]
    figures = misfit(recording, point.simulated, samples, warnings)
    return ExtendedFit(estimates=assessment.estimates, current_full=scales.current, **figures)


def extended_torque(values: Mapping[str, float], recording: Recording) -> list[np.ndarray]:
    """Torque of the extended model along each trajectory [unit of the recording].

    ``values`` are those of :attr:`ExtendedFit.values`; the measured torque only gives the inner scale.
    """
    scales = dataclasses.replace(Scales.of(recording), current=values["current_full"])
    samples = Dataset.of(recording, scales)
    inner = {name: values[name] / scales.factor(name) for name in LINEAR + SHAPE}
    structure = ExtendedStructure(samples)
    elements = Replay(samples).torque(structure.elements({name: inner[name] for name in SHAPE}))
    tau = structure.columns(samples, elements) @ np.array([inner[name] for name in LINEAR]) * scales.torque
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
        count, size = max(round(window / run.dt), 1), len(run.q)
        pad = 10 * count
        q = np.pad(run.q, pad, mode="edge")
        kernel = np.zeros(len(q))
        kernel[:count] = 1.0 / count
        h = np.fft.rfft(np.roll(kernel, -(count // 2)))
        q = np.fft.irfft(np.fft.rfft(q) * np.conj(h) / (np.abs(h) ** 2 + floor**2), len(q))[pad : pad + size]
        runs.append(dataclasses.replace(run, q=q, qd=np.gradient(q, run.dt), qd_derived=True))
    return dataclasses.replace(recording, trajectories=tuple(runs))


def prediction_errors(recording: Recording, simulated: Sequence[np.ndarray], window: float) -> dict[str, float]:
    """Root mean square error over standard deviation per trajectory.

    Where the measured torque passed a centred moving average of ``window`` [s], the simulated one passes the same, and
    both lose their mean, since such records come without one.
    """
    figures = {}
    for run, tau in zip(recording.trajectories, simulated, strict=True):
        error = tau - run.torque
        if window > 0.0:
            error = moving_average(tau, max(round(window / run.dt), 1)) - run.torque
            error -= error.mean()
        figures[run.id] = float(np.sqrt(np.mean(error**2)) / (run.torque.std() or 1.0))
    return figures
