"""The pickup-and-return task of section 6.5: walk out, stand while collecting, walk back loaded.

A window of every phase is simulated, and the electrical, battery and thermal models carry it over the whole phase: the
joints of a walking robot use the same power in every stride. With feedback, windings gain resistance and fluids lose
yield stress and viscosity as they warm up: a second pass walks with devices as warm as the first pass left them.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import torch

from mrwarp import paper
from mrwarp.energy import thermal
from mrwarp.energy.power import BatteryCfg, ElectricalCfg, JointLoad, battery_power, depletion, motor_heat
from mrwarp.energy.thermal import Temperatures, ThermalCfg
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.trials.walk_trials import ASSET_ROBOT, WalkCfg, robot_env, standing_load, walk
from mrwarp.trials.walking import PAYLOAD_VARIANT, Policy
from mrwarp.usd.asset import COIL, JointActuator, not_known
from mrwarp.usd.robot import CALF_COLUMNS

PHASES = ("outbound", "standby", "return")
"""Phases in order."""

SLICE = 10.0
"""Step of the temperature trace, and of the feedback on the windings [s]."""


STEEL = 460.0
"""Specific heat of steel [J/(kg·K)], of which a device is mostly made; handbooks."""


@dataclass(frozen=True, kw_only=True)
class MissionCfg:
    """The task and how it is simulated."""

    robots: tuple[str, ...] = paper.ROBOTS
    """Of :data:`mrwarp.paper.ROBOTS`."""
    speed: float = 0.3
    """Commanded speed [m/s]; not in the paper. At 0.3 m/s table 6 and the mission's powers agree."""
    distance: float = paper.DISTANCE
    """One way [m]."""
    standby: float = paper.STANDBY
    """Time of standing [s]."""
    outbound_load: float = field(default_factory=paper.arm_load)
    """Load on the way out and while standing [kg]; the default is the arm, see :func:`paper.arm_load`."""
    return_load: float = 3.0
    """Load on the way back [kg]: arm and item."""
    window: float = 10.0
    """Distance simulated of each walk [m]."""
    seeds: int = 3
    """Repetitions, from random poses and gait phases."""
    current: float = 1.5
    """Current the devices may use [A]."""
    feedback: bool = False
    """Whether temperatures act back on windings and fluids."""
    env: TaskCfg = field(default_factory=TaskCfg)
    """Actuator model, coupling and engine."""
    seed: int = 0
    """Seed of poses and phases."""

    def __post_init__(self) -> None:
        for name in ("speed", "distance", "standby", "window"):
            if not getattr(self, name) > 0.0:
                raise ValueError(f"{name} = {getattr(self, name)} must be positive")
        for name in ("outbound_load", "return_load"):
            if getattr(self, name) < 0.0:
                raise ValueError(f"{name} = {getattr(self, name)} kg must not be negative")


@dataclass(frozen=True, kw_only=True)
class PhaseLoad:
    """Measurements of the window of one phase; n repetitions."""

    joints: JointLoad
    """Shapes (n, J), (n, M)."""
    seconds: np.ndarray
    """Duration of the whole phase [s], shape (n,)."""
    speed: np.ndarray
    """Mean speed [m/s], shape (n,)."""
    trial: np.ndarray | None = None
    """Number of each repetition, shape (n,); None for one that stands for all."""
    tried: int = 1
    """Repetitions that began."""
    fell: int = 0
    """Of these fell in this phase."""
    late: int = 0
    """Of these did not cover the window in time."""
    paper_device: bool = True
    """See :class:`mrwarp.trials.walk_trials.WalkResult`."""

    def of(self, trials: np.ndarray) -> PhaseLoad:
        """The figures of some repetitions; what stands for all stays."""
        if self.trial is None:
            return self
        rows = np.isin(self.trial, trials)
        return replace(
            self, joints=self.joints[rows], seconds=self.seconds[rows], speed=self.speed[rows], trial=self.trial[rows]
        )


@dataclass(frozen=True, kw_only=True)
class MissionTrace:
    """One robot's mission over time, mean over seeds for the pictures; everything else per seed."""

    power: dict[str, np.ndarray]
    """Mean battery power per phase [W], shape (n,)."""
    seconds: dict[str, np.ndarray]
    """Duration per phase [s], shape (n,)."""
    depletion: np.ndarray
    """Fall of the state of charge over the mission [percentage points], shape (n,)."""
    rise: dict[str, np.ndarray]
    """``calf_walking``, ``calf_standby``, ``all``, ``proximal`` and ``fluid`` as in figure 11 [K], shape (n,)."""
    t: np.ndarray
    """Time [s], shape (T,)."""
    power_over_time: np.ndarray
    """[W], shape (T,)."""
    charge: np.ndarray
    """Fall of the state of charge so far [percentage points], shape (T,)."""
    calf: np.ndarray
    """Mean calf motor above ambient [K], shape (T,)."""
    proximal: np.ndarray
    """Mean hip and thigh motor above ambient [K], shape (T,)."""
    fluid: np.ndarray
    """Mean fluid temperature above ambient during each phase [K], shape (3, n)."""
    paper_device: bool = True
    """See :class:`mrwarp.trials.walk_trials.WalkResult`."""


class MissionError(RuntimeError):
    """A robot did not finish a window: it fell or stood still."""

    exit_code = 1


def heat_of_devices(devices: Sequence[JointActuator], heat: ThermalCfg) -> tuple[ThermalCfg, tuple[str, ...]]:
    """Numbers of the thermal model for a robot's devices, and what is not known of how they warm up.

    The defaults are assumed for the paper's device. Of another one its mass, taken as steel, gives the heat capacity;
    the surface of its housing is stated or not known.
    """
    if all(a.is_paper_device for a in devices):
        return heat, ()
    default, missing = ThermalCfg(), [name for name in not_known(devices) if name == COIL]
    masses = [a.model.device_mass.value for a in devices if a.model and a.model.device_mass]
    if heat.fluid_capacity == default.fluid_capacity:
        if len(masses) == len(devices):
            heat = replace(heat, fluid_capacity=STEEL * float(np.mean(masses)))
        else:
            missing.append("heat capacity (--set fluid_capacity=J/K, or the device's mass)")
    if heat.fluid_resistance == default.fluid_resistance:
        missing.append("heat resistance (--set fluid_resistance=K/W)")
    return heat, tuple(missing)


def measure(
    cfg: MissionCfg,
    policies: Mapping[str, Policy],
    report: Callable[[str, float], None] = lambda text, share: None,
    fluid: Mapping[str, np.ndarray] | None = None,
    thermal_cfg: ThermalCfg | None = None,
) -> dict[str, dict[str, PhaseLoad]]:
    """Simulate a window of every phase for every robot; what fell on one way is left out of the other too.

    ``fluid``: temperature of the fluids above ambient [K] by robot, shape (3,) over the phases; None is cold.

    Raises:
        MissionError: a robot did not finish a window in any repetition, or both windows in the same one.
    """
    found: dict[str, dict[str, PhaseLoad]] = {robot: {} for robot in cfg.robots}
    loads = {"outbound": cfg.outbound_load, "return": cfg.return_load}
    for k, (phase, load) in enumerate(loads.items()):
        place = PHASES.index(phase)
        warm = {robot: float(values[place]) for robot, values in (fluid or {}).items()}
        trial = WalkCfg(
            robots=cfg.robots,
            payloads=(load,),
            speeds=(cfg.speed,),
            trials=cfg.seeds,
            distance=cfg.window,
            current=cfg.current,
            env=cfg.env,
            seed=cfg.seed,
            derate=_derating(warm, cfg.seeds, thermal_cfg or ThermalCfg()) if warm else None,
        )
        for result in walk(trial, policies, lambda text, share, k=k: report(text, 0.45 * (k + share))):
            if not len(result.speed):
                raise MissionError(
                    f"{paper.NAMES[result.robot]} with {load:g} kg at {cfg.speed:g} m/s: {result.fell} of {cfg.seeds} "
                    f"fell, {result.late} too slow; lighten the load or choose another speed or policy"
                )
            found[result.robot][phase] = PhaseLoad(
                joints=result.joints,
                seconds=cfg.distance / result.speed,
                speed=result.speed,
                trial=result.trial,
                tried=cfg.seeds,
                fell=result.fell,
                late=result.late,
                paper_device=result.paper_device,
            )
    found = {robot: _paired(robot, walked) for robot, walked in found.items()}
    report("standing", 0.9)
    standing: dict[str, JointLoad] = {}
    for robot in cfg.robots:
        asset = ASSET_ROBOT[robot]
        if asset not in standing:
            env = replace(robot_env(cfg.env, robot, PAYLOAD_VARIANT), currents=(cfg.current,))
            standing[asset] = standing_load(env, load=cfg.outbound_load, hold=asset != "go1")[0]
        found[robot]["standby"] = PhaseLoad(
            joints=standing[asset][None], seconds=np.array([cfg.standby]), speed=np.zeros(1)
        )
    return {robot: {phase: uses[phase] for phase in PHASES} for robot, uses in found.items()}


def _paired(robot: str, walked: Mapping[str, PhaseLoad]) -> dict[str, PhaseLoad]:
    """Both walks of the repetitions that finished both, the same rows in each."""
    numbers = [phase.trial for phase in walked.values()]
    both = np.intersect1d(*numbers)  # type: ignore[arg-type]
    if not len(both):
        raise MissionError(
            f"{paper.NAMES[robot]}: no repetition finished both windows, only {numbers[0]} and {numbers[1]}; use more "
            "--trials or another policy"
        )
    return {name: phase.of(both) for name, phase in walked.items()}


def run(
    phases: Mapping[str, PhaseLoad], electrical: ElectricalCfg, heat: ThermalCfg, battery: BatteryCfg, *, feedback: bool
) -> MissionTrace:
    """Carry the windows over the phases: power, state of charge and temperatures.

    With ``feedback``, warm windings have more resistance.

    Raises:
        ValueError: the two walks are not of the same repetitions.
    """
    out, back = phases["outbound"], phases["return"]
    if len(out.speed) != len(back.speed) or not np.array_equal(out.trial, back.trial):  # type: ignore[arg-type]
        raise ValueError(f"repetitions {out.trial} went out and {back.trial} came back; they must be the same")
    count, devices = len(out.speed), out.joints.coil.shape[-1]
    calves = list(CALF_COLUMNS)
    others = [joint for joint in range(12) if joint not in calves]
    now = Temperatures.ambient((count,), 12, devices)
    zero = np.zeros(count)
    charge, elapsed = zero, zero
    samples = [(zero, zero, zero, zero, zero)]
    power: dict[str, np.ndarray] = {}
    durations: dict[str, np.ndarray] = {}
    change: dict[str, np.ndarray] = {}
    fluid = []
    for name in PHASES:
        # a robot that stands once stands for all
        joints, seconds = phases[name].joints, np.broadcast_to(phases[name].seconds, count)
        slices = max(round(float(seconds.mean()) / SLICE), 1)
        step = seconds / slices
        before, energy, warm = now, zero, np.zeros((count, devices))
        for _ in range(slices):
            rise = now.winding if feedback else np.zeros((count, 1))
            drawn = np.broadcast_to(battery_power(joints, electrical, rise).total, count)
            heat_motors = np.broadcast_to(motor_heat(joints, electrical, rise), (count, 12))
            now = thermal.step(now, heat_motors, joints.coil + joints.friction, step, heat)
            warm = warm + now.fluid / slices
            energy = energy + drawn * step
            charge = charge + depletion(drawn, step, battery)
            elapsed = elapsed + step
            housing = now.housing
            samples.append((elapsed, drawn, charge, housing[:, calves].mean(1), housing[:, others].mean(1)))
        power[name], durations[name] = energy / seconds, np.array(seconds)
        change[name] = (now.housing - before.housing)[:, calves].mean(1)
        fluid.append(warm.mean(1) if devices else zero)
    t, drawn, mean_charge, calf, proximal = (np.array(series).mean(axis=1) for series in zip(*samples, strict=True))
    drawn[0] = drawn[1]
    rises = {
        "calf_walking": change["outbound"] + change["return"],
        "calf_standby": change["standby"],
        "all": now.housing.mean(1),
        "proximal": now.housing[:, others].mean(1),
        "fluid": now.fluid.mean(1) if devices else zero,
    }
    return MissionTrace(
        power=power,
        seconds=durations,
        depletion=charge,
        rise=rises,
        fluid=np.array(fluid),
        t=t,
        power_over_time=drawn,
        charge=mean_charge,
        calf=calf,
        proximal=proximal,
        paper_device=out.paper_device,
    )


def calibrate(
    phases: Mapping[str, PhaseLoad], electrical: ElectricalCfg, heat: ThermalCfg, battery: BatteryCfg
) -> tuple[ThermalCfg, BatteryCfg, dict[str, Any]]:
    """Thermal numbers and battery capacity from Go1's rises and depletion of section 6.5.

    The numbers start from ``heat`` and ``battery``.
    """
    loss = {name: motor_heat(phases[name].joints, electrical).mean(0) for name in PHASES}
    seconds = {name: float(phases[name].seconds.mean()) for name in PHASES}
    target = paper.MISSION_RISE["go1"]
    rises = {name: target[name] for name in ("calf_walking", "calf_standby")}
    heat, got = thermal.calibrate(loss, seconds, rises, CALF_COLUMNS, heat)
    drop = float(run(phases, electrical, heat, battery, feedback=False).depletion.mean())
    depleted = paper.MISSION_DEPLETION["go1"][0]
    battery = replace(battery, capacity=battery.capacity * drop / depleted)
    return heat, battery, {"fitted": got, "measured": rises, "depletion": depleted}


def _derating(fluid: Mapping[str, float], seeds: int, cfg: ThermalCfg) -> Callable[[WalkEnv, Sequence[str]], None]:
    """Change of the devices' parameters by their fluids' temperatures above ambient [K], by robot."""

    def derate(env: WalkEnv, robots: Sequence[str]) -> None:
        if not env.actuator.mr_joints:
            return
        warm = np.repeat([fluid.get(robot, 0.0) for robot in robots], seeds)
        strength, viscosity = thermal.derated(warm, cfg)
        for names, factor in ((("T_max", "K0", "K1"), strength), (("B",), viscosity)):
            scale = torch.tensor(factor, dtype=torch.float32, device=env.device).unsqueeze(1)
            for name in names:
                env.view(env.actuator.param(name)).mul_(scale)

    return derate
