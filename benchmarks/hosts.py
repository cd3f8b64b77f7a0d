"""One device in every host: the torque that each gives along one motion, next to :class:`mrwarp.JointBatch`'s.

``python -m benchmarks.hosts`` writes ``docs/results/hosts.json``, whose table ``mrwarp reproduce docs`` puts on
docs/integrations.md. Hosts that cannot be imported keep the figures that are there: run it again with mjlab's Python.
"""

from __future__ import annotations

import argparse
import ctypes
import importlib
import json
import shutil
import subprocess
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.enums import Coupling
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, make_effect, save_model
from mrwarp.params import MrParams
from mrwarp.run_dir import plain, write_text

COMPILER = shutil.which("cc")
"""The C compiler, if there is one."""

RESULTS = Path(__file__).parents[1] / "docs/results/hosts.json"
"""The committed figures."""

STEPS = 120
"""Steps of a motion."""

TIMES = (0.001, 0.005, 0.02)
"""Steps of time [s]."""

RESET = 90
"""Step before which every host is reset."""

NEUTRAL = -1.5
"""Where the joint of the asset stands while the device is at its zero [rad]."""

NUMBERS: dict[str, dict[str, float]] = {
    "bouc_wen": {},
    "kwok": {"slope": 3.0, "width": 0.2, "rounding": 0.3},
    "arctangent": {"slope": 3.0, "speed": 0.2, "rounding": 8.0},
    "dahl": {"rate": 20.0},
    "lugre": {"rate": 20.0, "damping": 0.01, "stribeck": 0.4, "stribeck_speed": 0.5},
    "bouc_wen_power": {"rate": 20.0, "unloading": 0.2, "sharpness": 1.0},
    "spencer": {"rate": 30.0, "series": 2.0, "inner": 0.1, "spring": 0.5},
    "biviscous": {"speed": 0.4},
}
"""A device of each law."""

STRENGTHS: dict[str, dict[str, float]] = {
    "coil_lag": {"time_constant": 0.03},
    "command_delay": {"delay": 0.0172},
    "temperature_drift": {"yield_loss": 0.02, "viscosity_loss": 0.03, "time_constant": 37.0},
    "wear": {"rate": 0.05},
    "backlash": {"half_gap": 0.01},
    "series_compliance": {"compliance": 0.05, "difference": 0.3},
    "cogging": {"sine": 0.2, "cosine": -0.1, "periods": 24.0},
    "friction_asymmetry": {"coulomb": 0.2, "viscous": 0.05, "speed": 0.05},
}
"""Effects of the device at strengths that show."""

GROUPS: dict[str, tuple[str, ...]] = {
    "lag and delay": ("coil_lag", "command_delay"),
    "heat and wear": ("temperature_drift", "wear"),
    "play and spring": ("backlash", "series_compliance"),
    "cogging, friction by direction": ("cogging", "friction_asymmetry"),
    "all of them": tuple(STRENGTHS),
}
"""Rows of the table beyond the laws alone."""


@dataclass(frozen=True, kw_only=True)
class Case:
    """A device and a motion: angles [rad], velocities [rad/s] and currents [A] at the steps' starts, shape (STEPS,)."""

    name: str
    model: Model
    dt: float
    q: np.ndarray
    qd: np.ndarray
    current: np.ndarray


@dataclass(frozen=True, kw_only=True)
class Trace:
    """What a host gives in each step [N·m], shape (STEPS,); None where it gives no such thing."""

    torque: np.ndarray | None = None
    """The law's, positive against positive motion, as a bench logs it."""
    effort: np.ndarray | None = None
    """What an explicit host applies to the joint."""
    bound: np.ndarray | None = None
    """Dry friction that the solver may use."""


def device(law: str = "bouc_wen", effects: Iterable[str] = (), **values: float) -> Model:
    """A device of a law, with effects."""
    unit_loop = {
        "alpha": 0.0,
        "beta": 1.0,
        "gamma": 0.0,
        "K0": 0.2,
        "K1": 2.0,
        "D": 0.02,
        "C": 0.4,
        "I1": 0.05,
        "B": 0.05,
    }
    known = {**MrParams().to_dict(), **(unit_loop if law in HYSTERESIS else {}), "C": 0.6, **values}
    names = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma", "q_offset", "q_center", "T_max", "K", "n")
    parameters = {name: Parameter(value=known[name], unit=MrParams.spec(name).unit) for name in names}
    found: list[Effect] = [make_effect(law, NUMBERS[law])] if law in HYSTERESIS else []
    found += [make_effect(name, STRENGTHS[name]) for name in effects]
    origin = FittedOn(source="hosts", trajectories=1, samples=STEPS, rate=200.0, current=(0.0, 1.5))
    return Model(parameters=parameters, fitted_on=origin, effects=tuple(found))


def case(law: str, effects: Sequence[str], dt: float, sign: float = 1.0) -> Case:
    """A motion with reversals, rests, creeping and blows, under a current that steps; ``sign`` mirrors it."""
    k = np.arange(STEPS)
    qd = 3.0 * np.sin(2.0 * np.pi * k / 40.0)
    qd[52:60], qd[60:68], qd[100:104], qd[104:] = 0.0, 0.05, 6.0, -4.0
    q = 0.1 + np.cumsum(dt * qd)
    current = np.array([0.0, 1.0, 0.4, 1.5, 1.5, 0.7, 0.2, 1.2])[k // 15]
    q, qd, current = (x.astype(np.float32).astype(float) for x in (sign * q, sign * qd, current))
    name = f"{law}, {' + '.join(effects) or 'no effects'}, {1000 * dt:g} ms"
    return Case(name=name, model=device(law, effects), dt=dt, q=q, qd=qd, current=current)


def traced(case: Case, step: Callable[[float, float, float], dict[str, float]], reset: Callable[[], object]) -> Trace:
    """Step a host through a case."""
    rows = []
    for k, now in enumerate(zip(case.q, case.qd, case.current, strict=True)):
        if k == RESET:
            reset()
        rows.append(step(*now))
    return Trace(**{name: np.array([row[name] for row in rows], dtype=float) for name in rows[0]})


def joint_batch(case: Case) -> Trace:
    """``mrwarp.JointBatch``."""
    joints = JointBatch(case.model, dt=case.dt)

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        torque = joints.step(np.array([q]), np.array([qd]), np.array([current]))
        return {"torque": torque[0], "bound": joints.bound()[0]}

    return traced(case, step, joints.reset)


def mujoco_brake(case: Case) -> Trace:
    """``mrwarp.mujoco.Brake``, at the second of two braked joints of a model whose motor has a gear."""
    import mujoco

    from mrwarp.mujoco import Brake

    hinge = '<body><joint name="{0}" axis="0 1 0"/><geom size="0.1" mass="1"/></body>'
    model = mujoco.MjModel.from_xml_string(
        f'<mujoco><option timestep="{case.dt}"/><worldbody>{hinge.format("other")}{hinge.format("knee")}</worldbody>'
        '<actuator><motor joint="knee" gear="-9"/></actuator></mujoco>'
    )
    data = mujoco.MjData(model)
    other, brake = Brake(model, data, "other"), Brake(model, data, "knee", case.model)

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        data.qpos[1], data.qvel[1] = q, qd
        other.step(1.0)
        return {"bound": brake.step(current)}

    def reset() -> None:
        mujoco.mj_resetData(model, data)
        brake.reset()

    return traced(case, step, reset)


def _drive(case: Case, coupling: Coupling) -> Trace:
    import newton

    from mrwarp.actuator.newton_drive import DriveMR, drive_inputs

    builder = newton.ModelBuilder()
    link = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * 0.1))
    joint = builder.add_joint_revolute(parent=-1, child=link, axis=(0.0, 0.0, -1.0))
    builder.add_articulation([joint])
    with TemporaryDirectory() as folder:
        path = save_model(case.model, Path(folder) / "model.json")
        DriveMR.from_model(path, builder, index=builder.joint_qd_start[joint], coupling=coupling)
    model = builder.finalize(device="cpu")
    (actuator,) = model.actuators
    state, control = model.state(), model.control()
    q_all, qd_all, forces, drive = state.joint_q, state.joint_qd, control.joint_f, actuator.drive
    assert q_all is not None and qd_all is not None and forces is not None and isinstance(drive, DriveMR)
    inputs = drive_inputs(actuator, control)
    inputs.mr_foot_load = None
    states = [actuator.state(), actuator.state()]

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        for array, value in ((q_all, q), (qd_all, qd), (inputs.mr_current, current)):
            array.fill_(value)
        forces.zero_()
        actuator.step(state, control, *states, dt=case.dt)
        states.reverse()
        return (
            {"effort": forces.numpy()[0]} if coupling is Coupling.EXPLICIT else {"bound": drive.brake_bound.numpy()[0]}
        )

    def reset() -> None:
        assert states[0] is not None
        states[0].reset()

    return traced(case, step, reset)


def drive_explicit(case: Case) -> Trace:
    """``DriveMR`` in a Newton scene, as a torque."""
    return _drive(case, Coupling.EXPLICIT)


def drive_bound(case: Case) -> Trace:
    """``DriveMR`` in a Newton scene, as dry friction."""
    return _drive(case, Coupling.CONSTRAINT)


def python_export(case: Case) -> Trace:
    """The one-file NumPy export of ``mrwarp export``."""
    from mrwarp.export.writers import export_device

    with TemporaryDirectory() as folder:
        path = export_device(case.model, Path(folder), dt=case.dt)["python"]
        code: dict[str, Any] = {"__name__": "exported"}
        exec(compile(path.read_text(encoding="utf-8"), str(path), "exec"), code)  # noqa: S102 - made here
    joints = code["Joints"](1)

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        return {"torque": joints.step(q, qd, current)[0], "bound": joints.bound[0]}

    return traced(case, step, joints.reset)


C_SOURCE = """#include "mr_joint.h"
static mr_joint joint;
void step(float q, float qd, float current, float *out)
{{
    out[0] = mr_joint_step(&joint, q, qd, current);
    out[1] = joint.bound;
}}
void reset(void)
{{
    mr_joint rested = {{0}};
    {session}
    joint = rested;
}}
"""
"""A device behind the exported C header; the session, over which it wears, goes on after a reset."""


def c_export(case: Case) -> Trace:
    """The C header of ``mrwarp export``, compiled."""
    from mrwarp.export.writers import export_device

    folder = TemporaryDirectory()
    header = export_device(case.model, Path(folder.name), dt=case.dt)["c"]
    source, library = header.with_suffix(".c"), header.with_suffix(".so")
    session = "rested.steps = joint.steps;" if "int steps;" in header.read_text(encoding="utf-8") else ""
    source.write_text(C_SOURCE.format(session=session), encoding="utf-8")
    command = [COMPILER or "cc", "-std=c99", "-O2", "-shared", "-fPIC", str(source), "-o", str(library), "-lm"]
    subprocess.run(command, check=True)
    code = ctypes.CDLL(str(library))
    code.step.argtypes = [*[ctypes.c_float] * 3, ctypes.POINTER(ctypes.c_float)]
    out = (ctypes.c_float * 2)()

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        code.step(q, qd, current, out)
        return {"torque": out[0], "bound": out[1]}

    trace = traced(case, step, code.reset)
    folder.cleanup()
    return trace


def _environment(case: Case, coupling: Coupling) -> Trace:
    from benchmarks.verify.rigs import link_scene
    from mrwarp.env.config.sim_cfg import SimCfg
    from mrwarp.env.sim import ActuatedSim
    from mrwarp.usd.asset import JointActuator
    from mrwarp.usd.robot import MR_GO

    mr = case.model.to_params().alone().replace(q_neutral=NEUTRAL)
    joint = JointActuator(joint="joint", prim_path="", kp=0.0, kd=0.0, tau_limit=1.0, mr=mr, model=case.model)
    no_feet = replace(MR_GO, legs=(), neutral={joint.joint: NEUTRAL})
    scene = replace(link_scene(mr, dt=case.dt), actuators=(joint,), layout=no_feet)
    cfg = SimCfg(num_envs=1, dt=case.dt)
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(coupling=coupling))
    actuator = robot.actuator

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        for array, value in ((robot.sim.q, q + NEUTRAL), (robot.sim.qd, qd), (robot.current_e, current)):
            array.fill_(value)
        actuator.step()
        felt = ("effort", actuator.tau) if coupling is Coupling.EXPLICIT else ("bound", actuator.bound)
        return {"torque": actuator.tau_dyn.numpy()[0, 0], felt[0]: felt[1].numpy()[0, 0]}

    return traced(case, step, actuator.reset)


def environment_explicit(case: Case) -> Trace:
    """``MrActuator`` in the simulated robot, whose joint stands at :data:`NEUTRAL`, as a torque."""
    return _environment(case, Coupling.EXPLICIT)


def environment_bound(case: Case) -> Trace:
    """``MrActuator`` in the simulated robot, as dry friction."""
    return _environment(case, Coupling.CONSTRAINT)


@dataclass(frozen=True)
class MjlabRig:
    """Arms of mjlab with its MR actuator."""

    scene: Any
    sim: Any
    actuator: Any


def mjlab_arms(num_envs: int, dt: float, *, inertia: float = 0.1, **cfg: Any) -> MjlabRig:
    """Arms without weight whose motors give what they are told; ``cfg`` as of ``MrJointActuatorCfg``."""
    import mujoco
    from mjlab.entity import EntityArticulationInfoCfg, EntityCfg  # pyright: ignore[reportMissingImports]
    from mjlab.scene import Scene, SceneCfg  # pyright: ignore[reportMissingImports]
    from mjlab.sim.sim import MujocoCfg, Simulation, SimulationCfg  # pyright: ignore[reportMissingImports]

    from mrwarp.integrations.mjlab import MrJointActuatorCfg, brakes

    arm = (
        '<mujoco><worldbody><body name="base"><geom size="0.02" mass="1"/><body name="arm"><joint name="elbow" '
        f'axis="0 1 0"/><inertial pos="0 0 0" mass="1" diaginertia="{inertia} {inertia} {inertia}"/>'
        "</body></body></worldbody></mujoco>"
    )
    motor = MrJointActuatorCfg(target_names_expr=("elbow",), **{"stiffness": 0.0, "damping": 0.0, **cfg})
    entity = EntityCfg(
        spec_fn=lambda: mujoco.MjSpec.from_string(arm), articulation=EntityArticulationInfoCfg(actuators=(motor,))
    )
    scene = Scene(SceneCfg(num_envs=num_envs, entities={"robot": entity}), "cpu")
    settings = SimulationCfg(mujoco=MujocoCfg(timestep=dt))
    sim = Simulation(num_envs=num_envs, cfg=settings, model=scene.compile(), device="cpu")
    scene.initialize(sim.mj_model, sim.model, sim.data)
    sim.expand_model_fields(brakes.model_fields)
    (actuator,) = scene["robot"].actuators
    actuator.prepare_brake()
    return MjlabRig(scene, sim, actuator)


def _mjlab(case: Case, coupling: Coupling) -> Trace:
    with TemporaryDirectory() as folder:
        path = save_model(case.model, Path(folder) / "model.json")
        rig = mjlab_arms(1, case.dt, effort_limit=1.0, model=path, coupling=coupling)
    actuator = rig.actuator
    cmd = actuator.get_command(rig.scene["robot"].data)

    def step(q: float, qd: float, current: float) -> dict[str, float]:
        cmd.pos[:], cmd.vel[:], actuator.current[:] = q, qd, current
        effort = float(actuator.compute(cmd)[0, 0])
        return {"effort": effort} if coupling is Coupling.EXPLICIT else {"bound": float(actuator.brake_bound[0, 0])}

    return traced(case, step, actuator.reset)


def mjlab_explicit(case: Case) -> Trace:
    """mjlab's actuator, as a torque."""
    return _mjlab(case, Coupling.EXPLICIT)


def mjlab_bound(case: Case) -> Trace:
    """mjlab's actuator, as dry friction."""
    return _mjlab(case, Coupling.CONSTRAINT)


@dataclass(frozen=True, kw_only=True)
class Host:
    """A place where the joint runs."""

    name: str
    run: Callable[[Case], Trace]
    needs: str
    """Module, or the C compiler, that it cannot do without."""
    bound: float
    """Largest difference from ``JointBatch``, as a share of the case's largest torque."""

    @property
    def missing(self) -> str:
        """What it lacks here, and nothing where it can be run."""
        if self.needs == "cc":
            return "" if COMPILER else "a C compiler 'cc'"
        try:
            importlib.import_module(self.needs)
        except ImportError:
            return self.needs
        return ""


SAME = 1e-6
"""The same kernels on the same numbers: rounding of a dozen operations in 32 bits."""

SHIFTED = 1e-4
"""The same kernels on angles that are stored about another zero, rounded to 1e-7 rad of it; a device that is wound by
its spring bears some ten N·m/rad, and a step of a law's sign may come a rounding earlier."""

OTHER = 1e-4
"""The same laws by another compiler, or in 64 bits."""

HOSTS = (
    Host(name="`Brake`", run=mujoco_brake, needs="mujoco", bound=SAME),
    Host(name="`DriveMR`, explicit", run=drive_explicit, needs="newton", bound=SAME),
    Host(name="`DriveMR`, bound", run=drive_bound, needs="newton", bound=SAME),
    Host(name="`MrActuator`, explicit", run=environment_explicit, needs="mrwarp.env.sim", bound=SHIFTED),
    Host(name="`MrActuator`, bound", run=environment_bound, needs="mrwarp.env.sim", bound=SHIFTED),
    Host(name="exported C", run=c_export, needs="cc", bound=OTHER),
    Host(name="exported NumPy", run=python_export, needs="numpy", bound=OTHER),
    Host(name="mjlab, explicit", run=mjlab_explicit, needs="mjlab", bound=SAME),
    Host(name="mjlab, bound", run=mjlab_bound, needs="mjlab", bound=SAME),
)


def difference(got: Trace, wanted: Trace, qd: np.ndarray) -> float:
    """Largest difference of what a host gives, as a share of the largest torque; NaN counts as infinite."""
    assert wanted.torque is not None
    expected = {"torque": wanted.torque, "effort": -np.sign(qd) * np.abs(wanted.torque), "bound": wanted.bound}
    worst, scale = 0.0, float(np.abs(wanted.torque).max())
    for name, value in expected.items():
        if (found := getattr(got, name)) is not None:
            assert value is not None
            gap = float(np.abs(found - value).max()) / scale
            worst = max(worst, gap) if np.isfinite(gap) else float("inf")
    return worst


def rows(*, every: bool) -> dict[str, list[Case]]:
    """Cases by row of the table: with ``every`` all laws with all effects at all steps, else some that cover them."""
    found: dict[str, list[Case]] = {}
    for k, law in enumerate(NUMBERS):
        times = TIMES if every else (TIMES[k % len(TIMES)],)
        found[f"law: {law}"] = [case(law, (), dt, sign) for dt in times for sign in ((1.0, -1.0) if every else (1.0,))]
    for k, (group, effects) in enumerate(GROUPS.items()):
        laws, times = (tuple(NUMBERS), TIMES) if every else (("bouc_wen", "dahl")[k % 2 :][:1], (TIMES[(k + 1) % 3],))
        found[group] = [case(law, effects, dt, -1.0 if k % 2 else 1.0) for law in laws for dt in times]
    return found


def measured(hosts: Sequence[Host], cases: dict[str, list[Case]]) -> dict[str, dict[str, float]]:
    """Largest difference by row and host."""
    found: dict[str, dict[str, float]] = {}
    for row, members in cases.items():
        for one in members:
            wanted = joint_batch(one)
            for host in hosts:
                gap = difference(host.run(one), wanted, one.qd)
                found.setdefault(row, {})[host.name] = max(gap, found.get(row, {}).get(host.name, 0.0))
        print(row, *(f"{name} {gap:.1e}" for name, gap in found[row].items()), sep="; ", flush=True)
    return found


def main() -> None:
    """Measure the hosts that are here and write their figures to those of the others."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS, help="file of figures")
    out: Path = parser.parse_args().out
    before: dict[str, Any] = json.loads(out.read_text(encoding="utf-8")) if out.is_file() else {}
    cases = rows(every=True)
    found = measured([host for host in HOSTS if not host.missing], cases)
    table = {row: {**before.get("rows", {}).get(row, {}), **found[row]} for row in cases}
    bounds = {host.name: host.bound for host in HOSTS}
    count = {row: len(members) for row, members in cases.items()}
    content = {"command": "python -m benchmarks.hosts", "bounds": bounds, "cases": count, "rows": table}
    write_text(out, json.dumps(plain(content), indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    main()
