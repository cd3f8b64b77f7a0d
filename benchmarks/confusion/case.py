"""One case: a device with a hidden effect, its recording with noise, a second recording, and the truth."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lfilter

from benchmarks.confusion import foreign, outside
from benchmarks.confusion.effects import CALIBRATION, EFFECTS, UNCATALOGUED, Effect, room_temperature, true_value
from benchmarks.confusion.levels import level_of, strength_for
from benchmarks.confusion.mechanics import Joint
from benchmarks.confusion.motion import TRUTH_RATE, Motion, make_session
from benchmarks.confusion.truth import COIL_RESISTANCE, Device, simulate
from mrwarp.recording.differentiate import differentiate
from mrwarp.recording.load import Recording, Trajectory

_NEAR = 0.04
"""Largest relative miss of a level that is taken as it is; above, another session is drawn."""

SIZE_SPREAD = 1.25
"""Largest factor by which a strength differs from its typical one, either way."""

_ATTEMPTS = 8
"""Sessions that are drawn at most; then the one with the nearest level is taken."""

COLOUR_TIME = 0.05
"""Correlation time of the coloured noise [s]."""


@dataclass(frozen=True, kw_only=True)
class Noise:
    """Errors of the sensors, as standard deviations unless stated."""

    white: float
    """White noise of the torque [N·m]."""
    coloured: float
    """First-order noise of the torque [N·m], correlated over :data:`COLOUR_TIME`."""
    offset: float
    """Error of the torque's zero, new in each trajectory [N·m]."""
    gain: float
    """Error of the torque's gain, new in each trajectory [1]."""
    velocity: float
    """White noise of the velocity [rad/s]."""
    encoder: float
    """Step of the encoder [rad]; 0 for none."""

    @property
    def sigma(self) -> float:
        """White and coloured noise of the torque together [N·m]: the unit of levels."""
        return float(np.hypot(self.white, self.coloured))


NOISES: dict[str, Noise] = {
    "clean": Noise(white=0.010, coloured=0.005, offset=0.001, gain=0.001, velocity=0.003, encoder=0.00005),
    "realistic": Noise(white=0.020, coloured=0.010, offset=0.003, gain=0.003, velocity=0.01, encoder=0.0003),
    "harsh": Noise(white=0.020, coloured=0.010, offset=0.01, gain=0.01, velocity=0.03, encoder=0.0003),
}
"""Noise regimes by name."""


@dataclass(frozen=True, kw_only=True)
class Rendering:
    """The units and channels of a log. The device is the same; only what one unit means differs."""

    motion: float = 1.0
    """Unit of motion logged per rad; with ``linear`` metres."""
    current: float = 1.0
    """Unit of current logged per ampere; with ``voltage`` volts."""
    torque: float = 1.0
    """Unit of torque logged per N·m; with ``linear`` newtons."""
    linear: bool = False
    """A linear damper: m and N."""
    voltage: bool = False
    """The driver's voltage was logged instead of the current."""
    velocity: bool = True
    """Whether there is a velocity channel."""
    session_clock: bool = True
    """Time since the session began; otherwise each trajectory starts at 0 s and only the order of names is known."""

    @property
    def units(self) -> dict[str, str]:
        """Units as a recording states them."""
        return {
            "q": "m" if self.linear else "rad",
            "current": "V" if self.voltage else "A",
            "torque": "N" if self.linear else "N·m",
        }

    def factor(self, powers: tuple[int, int, int]) -> float:
        """Factor from rad, A and N·m to the logged units."""
        return self.motion ** powers[0] * self.current ** powers[1] * self.torque ** powers[2]

    def unit(self, unit: str) -> str:
        """A unit written with the logged ones."""
        if self.linear:
            unit = unit.replace("kg·m²", "kg").replace("N·m", "N").replace("rad", "m")
        return unit.replace("A", "V") if self.voltage else unit


LINEAR = {"motion": 0.04, "torque": 250.0}
"""A linear damper for :class:`Rendering`: a stroke of up to 24 mm and some hundred newtons."""

VOLTAGE = {"current": 6.0}
"""A voltage driver for :class:`Rendering`: 6 V per ampere."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """The hidden truth."""

    kinds: tuple[str, ...]
    """Effects of the contract; empty for none."""
    background: tuple[str, ...]
    """Effects outside the catalogue."""
    parameters: Mapping[str, Mapping[str, Any]]
    """For each effect ``parameter``, ``value`` and ``unit`` as logged, ``exact`` (whether a fit should find it), the
    ``level`` it has alone (None for a shift of calibration or a given strength) and its ``draws``."""
    depends_on: frozenset[str]
    """Variables of which the diagnosis has to name one for the background; empty without one."""
    base: Mapping[str, float]
    """The nine coefficients [rad, A, N·m]."""
    law: str = ""
    """Another law that the device follows; empty for eqs. 14 and 15."""
    also: tuple[str, ...] = ()
    """Effects that are there as well, and may be named or be a part of the baseline."""


@dataclass(frozen=True, kw_only=True)
class JointCase:
    """A data set of a joint without a device."""

    seed: int
    recording: Recording
    truth: Truth
    level: float
    noise_share: float | None = None
    """As of :class:`Case`; None where no ideal torque is known."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A data set with its truth."""

    seed: int
    device: Device
    motion: Motion
    """Motion of the recording."""
    noise: Noise
    rendering: Rendering
    truth: Truth
    level: float
    """Level of everything hidden together, measured; 0 for none."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """How the case was asked for."""

    @cached_property
    def recording(self) -> Recording:
        """The recording that the diagnosis sees."""
        return self.record(self.motion, stream=3)

    @cached_property
    def noise_share(self) -> float:
        """RMS of all that was added to the ideal torque, over the standard deviation of the logged one [1]."""
        logged = np.stack([run.torque for run in self.recording.trajectories])
        ideal = self.rendering.torque * simulate(self.device, self.motion).torque
        return float(np.sqrt(np.mean((logged - ideal) ** 2)) / logged.std())

    def record(self, motion: Motion, *, stream: int, noise: Noise | None = None) -> Recording:
        """Run the case's device through any motion and log it.

        Args:
            motion: Motion and command.
            stream: Which of the seed's streams the noise takes.
            noise: Other noise than the case's.
        """
        return _log(
            self.device, motion, noise or self.noise, self.rendering, np.random.default_rng(_stream(self.seed, stream))
        )


def make_case(
    kind: str | Sequence[str],
    *,
    level: float,
    seed: int,
    size: str = "large",
    noise: str | Noise = "realistic",
    base_spread: float = 0.02,
    background: str | None = None,
    rate: float = 200.0,
    linear: bool = False,
    voltage: bool = False,
    velocity: bool = True,
    session_clock: bool = True,
    clock_error: float = 0.005,
    truth_rate: float = TRUTH_RATE,
    motion: str = "mixed",
    strengths: Mapping[str, float] | None = None,
) -> Case:
    """Make a data set with a hidden effect.

    Args:
        kind: Effect, several effects, or "none".
        level: RMS of what survives re-fitting the baseline over the RMS of the noise, for each effect alone.
        seed: Seed of the device, its motion, the effects' draws and the noise.
        size: "large" (32 trajectories of 8 s) or "small" (12 of 4 s).
        noise: Name of a noise regime, or the noise itself.
        base_spread: Largest deviation of the nine coefficients from the paper's.
        background: An effect outside the catalogue of the same level behind it.
        rate: Logging rate [1/s], 100 to 3000.
        linear: Log a linear damper [m, N].
        voltage: Log a voltage instead of the current.
        velocity: Whether a velocity channel is logged; without one it is derived from q as when a file is read.
        session_clock: Whether the time runs on between trajectories.
        clock_error: See :func:`~benchmarks.confusion.motion.make_session`.
        truth_rate: See there.
        motion: See there.
        strengths: Typical ones of effects, drawn within a factor of :data:`SIZE_SPREAD` instead of by ``level``.
    """
    kinds = () if kind == "none" else (kind,) if isinstance(kind, str) else tuple(kind)
    hidden = (*kinds, *([background] if background else []))
    for name in hidden:
        if name not in EFFECTS:
            raise ValueError(f"kind = {name!r} is unknown; none, or of: {', '.join(EFFECTS)}")
    if "velocity_lag" in hidden and not velocity:
        raise ValueError("velocity_lag cannot be hidden in a log without velocity")
    errors = NOISES[noise] if isinstance(noise, str) else noise
    plain = Device.drawn(base_spread, _stream(seed, 1))
    typical = strengths or {}
    taken, effects, closest = None, {}, np.inf
    for attempt in range(_ATTEMPTS):
        drawn = make_session(
            size=size,
            rate=rate,
            seed=_stream(seed, 0, attempt),
            clock_error=clock_error,
            truth_rate=truth_rate,
            motion=motion,
        )
        rng = np.random.default_rng(_stream(seed, 2))
        found = {name: _effect(name, level, plain, drawn, errors.sigma, rng, typical.get(name)) for name in hidden}
        off = max((miss for _, miss in found.values()), default=0.0)
        if taken is None or off < closest:
            taken, effects, closest = drawn, {name: effect for name, (effect, _) in found.items()}, off
        if closest < _NEAR:
            break
    assert taken is not None
    device = plain.with_effects(effects)
    rendering = Rendering(
        **(LINEAR if linear else {}),
        **(VOLTAGE if voltage else {}),
        linear=linear,
        voltage=voltage,
        velocity=velocity,
        session_clock=session_clock,
    )
    outside = tuple(name for name in hidden if name in UNCATALOGUED)
    return Case(
        seed=seed,
        device=device,
        motion=taken,
        noise=errors,
        rendering=rendering,
        truth=Truth(
            kinds=tuple(name for name in hidden if name not in UNCATALOGUED),
            background=outside,
            parameters={
                name: _stated(name, effects[name], rendering, None if name in typical else level) for name in hidden
            },
            depends_on=frozenset().union(*(EFFECTS[name].depends_on for name in outside)),
            base=plain.base,
        ),
        level=level_of(device, taken, errors.sigma) if hidden else 0.0,
        settings={"size": size, "clock_error": clock_error, "truth_rate": truth_rate},
    )


def make_foreign(kind: str, law: str, *, share: float, seed: int, size: str = "large", noise: float = 0.01) -> Case:
    """Make a data set of a device by another law.

    Args:
        kind: Effect, several joined by "+", or "none".
        law: One of :data:`benchmarks.confusion.foreign.LAWS` or of :data:`benchmarks.confusion.outside.LAWS`.
        share: RMS of what each effect alone changes in the torque, over the torque's RMS.
        seed: Seed of the device, its motion, the effects' draws and the noise.
        size: As in :func:`make_case`.
        noise: White noise of the torque over its RMS; the other errors are those of the regime "clean".
    """
    hidden = () if kind == "none" else tuple(kind.split("+"))
    motion = make_session(size=size, rate=200.0, seed=_stream(seed, 0, 0), clock_error=0.005, truth_rate=TRUTH_RATE)
    plain = replace(Device.drawn(0.0, _stream(seed, 1)), law=law, numbers=foreign.drawn(law, _stream(seed, 1)))
    torque = simulate(plain, motion).torque
    rms = float(np.sqrt(np.mean(torque**2)))
    rng = np.random.default_rng(_stream(seed, 2))
    effects = {}
    for name in hidden:
        draws, strength = EFFECTS[name].draw(rng), EFFECTS[name].guess
        if name == "friction_asymmetry":  # if dry it is a constant while the joint moves, which D takes up
            draws = {**draws, "viscous": 1.0}
        for _ in range(3 if name in foreign.BEHIND else 4):  # the change is nearly proportional to the strength
            moved = simulate(plain.with_effects({name: Effect(strength=strength, draws=draws)}), motion).torque
            strength *= share * rms / float(np.sqrt(np.mean((moved - torque) ** 2)))
        effects[name] = Effect(strength=strength, draws=draws)
    rendering, errors = Rendering(), replace(NOISES["clean"], white=noise * rms, coloured=0.3 * noise * rms)
    return Case(
        seed=seed,
        device=plain.with_effects(effects),
        motion=motion,
        noise=errors,
        rendering=rendering,
        truth=Truth(
            kinds=hidden,
            background=(),
            parameters={name: _stated(name, effects[name], rendering, share) for name in hidden},
            depends_on=frozenset(),
            base={},
            law=law,
            also=outside.ALSO.get(law, ()),
        ),
        level=share if hidden else 0.0,
        settings={"size": size, "clock_error": 0.005, "truth_rate": TRUTH_RATE},
    )


def make_joint(kind: str, law: str, *, share: float, seed: int) -> JointCase:
    """Make a data set of a joint without a device.

    Args:
        kind: Hidden effect of :data:`benchmarks.confusion.mechanics.HIDDEN`.
        law: One of :data:`benchmarks.confusion.mechanics.JOINTS`.
        share: RMS of what it changes in the torque, over the torque's.
        seed: Seed of the joint, its motion and the noise.
    """
    joint = Joint.drawn(law, kind, share, seed)
    truth = Truth(
        kinds=tuple(joint.parameters),
        background=(),
        parameters=joint.parameters,
        depends_on=frozenset(),
        base={},
        also=("coulomb_friction",),
    )
    return JointCase(seed=seed, recording=joint.recording(), truth=truth, level=share if joint.hidden else 0.0)


def write_case(case: Case | JointCase, folder: str | Path) -> None:
    """Write a case as CSV files (docs/data.md) and ``truth.json``."""
    folder = Path(folder)
    write_recording(case.recording, folder)
    truth = {**asdict(case.truth), "depends_on": sorted(case.truth.depends_on), "level": case.level, "seed": case.seed}
    (folder / "truth.json").write_text(json.dumps(truth, indent=1, ensure_ascii=False) + "\n", encoding="utf-8")


def write_recording(recording: Recording, folder: str | Path) -> None:
    """Write a recording as a folder of CSV files; a derived velocity is left out."""
    folder = Path(folder)
    folder.mkdir(parents=True, exist_ok=True)
    if recording.units != {"q": "rad", "current": "A", "torque": "N·m"}:
        (folder / "units.json").write_text(json.dumps(recording.units, ensure_ascii=False) + "\n", encoding="utf-8")
    for run in recording.trajectories:
        names = ["t", "q", "qd", "current", "torque"]
        if run.qd_derived:
            names.remove("qd")
        if run.temperature is not None:
            names.append("temperature")
        np.savetxt(
            folder / f"{run.id}.csv",
            np.stack([getattr(run, name) for name in names], axis=1),
            fmt="%.10g",
            delimiter=",",
            header=",".join(names),
            comments="",
        )


def _stream(seed: int, *stream: int) -> np.random.SeedSequence:
    """Independent random streams of one seed: motion, device, effects, noise."""
    return np.random.SeedSequence([seed, *stream])


def _effect(
    name: str,
    level: float,
    device: Device,
    motion: Motion,
    sigma: float,
    rng: np.random.Generator,
    typical: float | None,
) -> tuple[Effect, float]:
    """An effect of the level, or near its typical strength, and by which share the level is missed."""
    spec = EFFECTS[name]
    draws = spec.draw(rng)
    if typical is not None:
        return Effect(strength=typical * SIZE_SPREAD ** rng.uniform(-1.0, 1.0), draws=draws), 0.0
    if spec.size is not None:
        return Effect(strength=spec.size, draws=draws), 0.0
    effect, found = strength_for(name, draws, level=level, device=device, motion=motion, sigma=sigma)
    if effect.strength >= spec.largest:  # the law ends there; in the other direction it does not
        draws = {**draws, "sign": -draws["sign"]}
        effect, found = strength_for(name, draws, level=level, device=device, motion=motion, sigma=sigma)
    return effect, abs(found / level - 1.0)


def _stated(name: str, effect: Effect, rendering: Rendering, level: float | None) -> dict[str, Any]:
    value = true_value(name, effect)
    return {
        "parameter": value.parameter,
        "value": value.value * rendering.factor(value.powers),
        "unit": rendering.unit(value.unit),
        "exact": value.exact,
        "level": None if name in CALIBRATION else level,
        "draws": dict(effect.draws),
    }


def _log(device: Device, motion: Motion, noise: Noise, rendering: Rendering, rng: np.random.Generator) -> Recording:
    """The logger's columns: errors added, rounded to more digits than the sensors resolve."""
    signals = simulate(device, motion)
    shape, step = signals.torque.shape, 1.0 / motion.rate
    torque = signals.torque * (1.0 + noise.gain * rng.standard_normal((shape[0], 1)))
    torque += noise.offset * rng.standard_normal((shape[0], 1)) + noise.white * rng.standard_normal(shape)
    kept = np.exp(-step / COLOUR_TIME)
    shocks = rng.standard_normal(shape) * np.sqrt(1.0 - kept * kept)
    shocks[:, 0] /= np.sqrt(1.0 - kept * kept)
    torque += noise.coloured * np.asarray(lfilter([1.0], [1.0, -kept], shocks, axis=1))
    qd = signals.qd + noise.velocity * rng.standard_normal(shape)
    q = np.round(signals.q / noise.encoder) * noise.encoder if noise.encoder > 0.0 else signals.q

    t = np.arange(shape[1]) * step
    fade = device.effects.get("temperature_fade")
    room = None if fade is None else room_temperature(fade, motion.start)
    count = len(str(shape[0] - 1))
    runs = []
    for k in range(shape[0]):
        angle = np.round(rendering.motion * q[k], 9)
        runs.append(
            Trajectory(
                id=f"{k:0{count}d}-{motion.kind[k]}",
                t=np.round(t + (motion.start[k] if rendering.session_clock else 0.0), 7),
                q=angle,
                qd=np.round(rendering.motion * qd[k], 8) if rendering.velocity else differentiate(angle, step),
                current=np.round(rendering.current * signals.current[k], 9),
                torque=np.round(rendering.torque * torque[k], 7),
                temperature=None if room is None else np.full(shape[1], room[k]),
                qd_derived=not rendering.velocity,
            )
        )
    header = {"made_by": "benchmarks.confusion", "coil_resistance": COIL_RESISTANCE}
    return Recording(trajectories=tuple(runs), units=rendering.units, header=header)
