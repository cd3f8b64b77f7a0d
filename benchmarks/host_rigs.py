"""The hosts of :mod:`benchmarks.hosts`, each of which runs one device along a prescribed motion."""

from __future__ import annotations

import ctypes
import shutil
import subprocess
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import warp as wp

from benchmarks.host_cases import NEUTRAL, Case, Trace, traced
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.enums import Coupling
from mrwarp.model_file import save_model

COMPILER = shutil.which("cc")
"""The C compiler, if there is one."""


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
    """Arms without weight whose motors give their commanded torque; ``cfg`` as of ``MrJointActuatorCfg``."""
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
