"""One device in every host: the same torque along a motion, and thrown joints are caught at any step.

mjlab's hosts run in its own environment, `make test-mjlab`, and are skipped elsewhere.
"""

import ctypes
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
import warp as wp

from benchmarks import hosts
from benchmarks.host_cases import NEUTRAL, NUMBERS, STRENGTHS, Case, case, device
from benchmarks.host_rigs import joint_batch, mjlab_arms
from benchmarks.hosts import HOSTS, Host
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.effects.catalogue import CATALOGUE, HYSTERESIS
from mrwarp.enums import BackendKind, Coupling
from mrwarp.export.writers import export_device
from mrwarp.model_file import save_model
from mrwarp.mujoco import Brake
from mrwarp.params import MrParams
from tests.export.test_export import CC, compiled, loaded

SHARES = [pytest.param(host, id=host.name.replace("`", "")) for host in HOSTS]


def test_the_matrix_has_every_law() -> None:
    """A law that joins the list joins the matrix."""
    assert set(NUMBERS) == {"bouc_wen", *HYSTERESIS}
    assert {name for names in hosts.GROUPS.values() for name in names} == set(STRENGTHS)
    assert all(CATALOGUE[name].kind == "mechanism" for name in STRENGTHS)


@pytest.fixture(scope="module")
def rows() -> Iterator[dict[str, list[Case]]]:
    """Cases that cover the matrix, whose torques by ``JointBatch`` are computed once."""
    rows = hosts.rows(every=False)
    known = {id(one): joint_batch(one) for members in rows.values() for one in members}
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(hosts.rigs, "joint_batch", lambda one: known[id(one)])
        yield rows


@pytest.mark.parametrize("host", SHARES)
def test_a_host_gives_the_torque_of_joint_batch(host: Host, rows: dict[str, list[Case]]) -> None:
    """Along motions that reverse, rest and are reset in the middle, within the bound that the page states."""
    if host.missing:
        pytest.skip(f"{host.name} needs {host.missing}; mjlab has an environment of its own: make test-mjlab")
    for row, gaps in hosts.measured([host], rows).items():
        assert gaps[host.name] <= host.bound, row


def test_a_difference_is_seen() -> None:
    """Another neutral angle, which is no number of a device, and a NaN."""
    one = case("bouc_wen", ("cogging",), 0.005)
    wanted = joint_batch(one)
    assert wanted.bound is not None
    other = joint_batch(replace(one, q=one.q - NEUTRAL))
    assert hosts.difference(other, wanted, one.qd) > 0.05
    assert hosts.difference(replace(wanted, bound=wanted.bound * np.nan), wanted, one.qd) == np.inf


LOAD = 8.0
"""Torque against which joints are thrown [N·m]."""

CURRENT = float(MrParams().hold.current_for(23.0))
"""Current at which the device holds 23 N·m [A]; it slides with 2 to 3 N·m."""

SPEEDS = np.linspace(0.5, 6.0, 20)
"""Speeds of the throws [rad/s]."""


@dataclass(frozen=True)
class Thrown:
    """Angles [rad] and speeds [rad/s] of all throws after each step, shape (T + 1, 20)."""

    q: np.ndarray
    qd: np.ndarray


@dataclass(frozen=True)
class Thrower:
    """A host with 20 joints."""

    throw: Callable[[np.ndarray], object]
    """Reset the host and its plant, and throw the joints from an angle of 0 at these speeds [rad/s]."""
    step: Callable[[], tuple[np.ndarray, np.ndarray]]
    """Make a step of the simulation; gives angles and speeds after it."""


def thrown(host: Thrower, dt: float, speeds: np.ndarray = SPEEDS, seconds: float = 0.25) -> Thrown:
    """The motion after a throw."""
    host.throw(speeds)
    steps = (tuple(np.array(x, dtype=float) for x in host.step()) for _ in range(round(seconds / dt)))
    return Thrown(*(np.array(x) for x in zip((0.0 * speeds, speeds), *steps, strict=True)))


def own_plant(
    inertia: float, dt: float, reset: Callable[[], None], bound: Callable[[np.ndarray, np.ndarray], np.ndarray]
) -> Thrower:
    """Joints by semi-implicit Euler with dry friction of ``bound(q, qd)``, in the loop that exported files state."""
    q, qd, load = np.zeros(20), np.zeros(20), -LOAD

    def throw(speeds: np.ndarray) -> None:
        nonlocal q, qd
        reset()
        q, qd = 0.0 * speeds, speeds

    def step() -> tuple[np.ndarray, np.ndarray]:
        nonlocal q, qd
        most = bound(q, qd) / inertia * dt
        free = qd + load / inertia * dt
        qd = free - np.clip(free, -most, most)
        q = q + qd * dt
        return q, qd

    return Thrower(throw, step)


def thrown_batch(inertia: float, dt: float) -> Thrower:
    """``JointBatch`` and a plant of its own."""
    joints = JointBatch(num=20, dt=dt)

    def bound(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        joints.step(q, qd, CURRENT)
        return joints.bound()

    return own_plant(inertia, dt, joints.reset, bound)


def exported(folder: str, kind: str, dt: float) -> Path:
    """The thrown device in a file of another language."""
    return export_device(device(C=0.0), Path(folder), dt=dt)[kind]


def thrown_numpy(inertia: float, dt: float) -> Thrower:
    """The exported file of Python, in the loop that its docstring states."""
    with TemporaryDirectory() as folder:
        joints = loaded(exported(folder, "python", dt)).Joints(20)

    def bound(q: np.ndarray, qd: np.ndarray) -> np.ndarray:
        joints.step(q, qd, CURRENT)
        return joints.bound

    return own_plant(inertia, dt, joints.reset, bound)


C_LOOP = """#include <string.h>
#include "{name}.h"
static {name} joints[20];
void rest(void) {{ memset(joints, 0, sizeof joints); }}
void step(float *q, float *qd, float current, float load, float inertia)
{{
    for (int k = 0; k < 20; k++) {{
        {name}_step(&joints[k], q[k], qd[k], current);
        const float free = qd[k] + load / inertia * MR_JOINT_DT, most = joints[k].bound / inertia * MR_JOINT_DT;
        qd[k] = free - fminf(fmaxf(free, -most), most);
        q[k] += qd[k] * MR_JOINT_DT;
    }}
}}
"""
"""Twenty joints in the loop that the exported header states."""


def thrown_c(inertia: float, dt: float) -> Thrower:
    """The exported C header."""
    if CC is None:
        pytest.skip("no C compiler 'cc' on this machine")
    with TemporaryDirectory() as folder:
        code = compiled(exported(folder, "c", dt), C_LOOP)
    floats = np.ctypeslib.ndpointer(np.float32, flags="C")
    code.step.argtypes = [floats, floats, *[ctypes.c_float] * 3]
    q, qd = np.zeros(20, np.float32), np.zeros(20, np.float32)

    def throw(speeds: np.ndarray) -> None:
        code.rest()
        q[:], qd[:] = 0.0, speeds

    def step() -> tuple[np.ndarray, np.ndarray]:
        code.step(q, qd, CURRENT, -LOAD, inertia)
        return q, qd

    return Thrower(throw, step)


C_BRAKES = """#include "{name}_mujoco.h"
static {name}_brake brakes[20];
int install(mjModel *m, const mjData *d, int joint) {{ return {name}_install(&brakes[joint], m, d, joint); }}
void rest(void)
{{
    for (int k = 0; k < 20; k++)
        memset(&brakes[k].joint, 0, sizeof brakes[k].joint);
}}
void step(mjModel *m, mjData *d, float current)
{{
    for (int k = 0; k < 20; k++)
        {name}_apply(&brakes[k], m, d, current);
    mj_step(m, d);
}}
"""
"""Twenty brakes of the exported header for MuJoCo."""


def joints_of_mujoco(inertia: float, dt: float) -> tuple[mujoco.MjModel, mujoco.MjData]:
    """Twenty hinges in plain MuJoCo."""
    size = f'diaginertia="{inertia} {inertia} {inertia}"'
    bodies = "".join(
        f'<body><joint name="j{k}" axis="0 1 0"/><inertial pos="0 0 0" mass="1" {size}/></body>' for k in range(20)
    )
    text = f'<mujoco><option timestep="{dt}" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    return model, mujoco.MjData(model)


def thrown_mujoco_c(inertia: float, dt: float) -> Thrower:
    """The exported C header for MuJoCo."""
    if CC is None:
        pytest.skip("no C compiler 'cc' on this machine")
    root = Path(mujoco.__file__).parent
    linked = ["-isystem", str(root / "include"), str(next(root.glob("libmujoco.so.*")))]
    with TemporaryDirectory() as folder:
        code = compiled(exported(folder, "c", dt), C_BRAKES, *linked)
    code.install.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_int]
    code.step.argtypes = [ctypes.c_void_p, ctypes.c_void_p, ctypes.c_float]
    model, data = joints_of_mujoco(inertia, dt)
    assert all(code.install(model._address, data._address, k) for k in range(20))

    def throw(speeds: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        code.rest()
        data.qvel[:], data.qfrc_applied[:] = speeds, -LOAD

    def step() -> tuple[np.ndarray, np.ndarray]:
        code.step(model._address, data._address, CURRENT)
        return data.qpos.copy(), data.qvel.copy()

    return Thrower(throw, step)


def thrown_brakes(inertia: float, dt: float) -> Thrower:
    """Twenty brakes in one model of plain MuJoCo."""
    model, data = joints_of_mujoco(inertia, dt)
    brakes = [Brake(model, data, k) for k in range(20)]

    def throw(speeds: np.ndarray) -> None:
        mujoco.mj_resetData(model, data)
        for brake in brakes:
            brake.reset()
        data.qvel[:], data.qfrc_applied[:] = speeds, -LOAD

    def step() -> tuple[np.ndarray, np.ndarray]:
        for brake in brakes:
            brake.step(CURRENT)
        mujoco.mj_step(model, data)
        return data.qpos.copy(), data.qvel.copy()

    return Thrower(throw, step)


def thrown_drive(inertia: float, dt: float) -> Thrower:
    """Newton's drive and solver."""
    newton = pytest.importorskip("newton")
    from mrwarp.actuator.newton_drive import DriveMR, apply_brake_bounds, drive_inputs

    builder = newton.ModelBuilder()
    with TemporaryDirectory() as folder:
        path = save_model(device(C=0.0), Path(folder) / "model.json")
        for _ in range(20):
            builder.begin_world()
            body = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * inertia))
            joint = builder.add_joint_revolute(parent=-1, child=body, axis=(0.0, 0.0, 1.0), armature=0.0)
            builder.add_articulation([joint])
            DriveMR.from_model(path, builder, index=builder.joint_qd_start[joint], coupling="constraint")
            builder.end_world()
    model = builder.finalize(device="cpu")
    solver = newton.solvers.SolverMuJoCo(model)
    (actuator,) = model.actuators
    scenes, control, states = [model.state(), model.state()], model.control(), [actuator.state(), actuator.state()]
    inputs = drive_inputs(actuator, control)
    inputs.mr_foot_load = None
    inputs.mr_current.fill_(CURRENT)
    control.joint_act.fill_(-LOAD)

    def throw(speeds: np.ndarray) -> None:
        states[0].reset()
        scenes[0].joint_q.zero_()
        scenes[0].joint_qd.assign(speeds.astype(np.float32))

    def step() -> tuple[np.ndarray, np.ndarray]:
        control.joint_f.zero_()
        actuator.step(scenes[0], control, *states, dt=dt)
        states.reverse()
        apply_brake_bounds(solver, actuator, dt)
        solver.step(scenes[0], scenes[1], control, None, dt)
        scenes.reverse()
        return scenes[0].joint_q.numpy(), scenes[0].joint_qd.numpy()

    return Thrower(throw, step)


def thrown_environment(inertia: float, dt: float, backend: BackendKind | None = None) -> Thrower:
    """The simulated robot's joint."""
    pytest.importorskip("newton")
    from benchmarks.verify.rigs import Link, Load, link_scene
    from mrwarp.env.config.sim_cfg import SimCfg
    from mrwarp.env.sim import ActuatedSim
    from mrwarp.usd.robot import MR_GO

    link = Link(mass=0.3, com=0.0, inertia=inertia)
    scene = link_scene(MrParams().alone(), dt=dt, link=link)
    scene = replace(scene, layout=replace(MR_GO, legs=(), neutral={"joint": 0.0}))
    cfg = SimCfg(num_envs=20, dt=dt, backend=backend)
    robot = ActuatedSim(scene, cfg, MrActuatorCfg(coupling=Coupling.CONSTRAINT))
    robot.current_e.fill_(CURRENT)
    load = Load(robot)

    def throw(speeds: np.ndarray) -> None:
        robot.reset(qvel=wp.array(speeds[:, None], dtype=float, device="cpu"))
        load.set(np.full(20, -LOAD))  # a reset takes it off

    def step() -> tuple[np.ndarray, np.ndarray]:
        robot.step()
        return robot.sim.q.numpy()[:, 0], robot.sim.qd.numpy()[:, 0]

    return Thrower(throw, step)


def thrown_warp(inertia: float, dt: float) -> Thrower:
    """That joint on MuJoCo-Warp."""
    return thrown_environment(inertia, dt, BackendKind.MJWARP)


def thrown_mjlab(inertia: float, dt: float) -> Thrower:
    """mjlab's actuator and solver."""
    pytest.importorskip("mjlab", reason="mjlab has an environment of its own: make test-mjlab")
    import torch

    rig = mjlab_arms(20, dt, inertia=inertia, effort_limit=2.0 * LOAD)
    robot = rig.scene["robot"]
    robot.set_joint_effort_target(torch.full((20, 1), -LOAD))
    rig.actuator.current[:] = CURRENT

    def throw(speeds: np.ndarray) -> None:
        rig.actuator.reset()
        robot.write_joint_position_to_sim(torch.zeros(20, 1))
        robot.write_joint_velocity_to_sim(torch.tensor(speeds, dtype=torch.float)[:, None])
        rig.scene.update(dt)

    def step() -> tuple[np.ndarray, np.ndarray]:
        rig.scene.write_data_to_sim()
        rig.sim.step()
        rig.scene.update(dt)
        return robot.data.joint_pos[:, 0].numpy().copy(), robot.data.joint_vel[:, 0].numpy().copy()

    return Thrower(throw, step)


THROWN = {
    "JointBatch": thrown_batch,
    "exported NumPy": thrown_numpy,
    "exported C": thrown_c,
    "exported C for MuJoCo": thrown_mujoco_c,
    "Brake": thrown_brakes,
    "DriveMR": thrown_drive,
    "env": thrown_environment,
    "env, mjwarp": thrown_warp,
    "mjlab": thrown_mjlab,
}


@pytest.mark.parametrize(("inertia", "dt"), [(0.001, 0.02), (0.01, 0.005), (0.1, 0.01)])
@pytest.mark.parametrize("host", THROWN)
def test_thrown_joints_are_caught_where_they_turn_round(host: str, inertia: float, dt: float) -> None:
    """All of 20 throws, where the friction and the load stop them but for the motion of one step; no energy appears.

    The joint slides against the load and 0 to 4 N·m of the device. Its place may differ by a step at its speed, and by
    one under the load: where it turns round within the first step, no step before shows its acceleration.
    """
    run = thrown(THROWN[host](inertia, dt), dt)
    assert (np.abs(run.qd[-1]) < 3e-4).all()
    least, most = (inertia * SPEEDS**2 / (2.0 * (LOAD + drag)) for drag in (4.0, 0.0))
    step = SPEEDS * dt + LOAD * dt**2 / inertia
    assert (least - step <= run.q[-1]).all() and (run.q[-1] <= most + step).all()
    back = run.q.max(axis=0) - run.q[-1]
    assert back.max() <= LOAD * dt**2 / inertia + 3e-4 * 0.25  # as docs/integrations.md states it, and creep
    energy = 0.5 * inertia * run.qd**2 + LOAD * run.q
    # angles of 32 bits, and velocities that stop at a few roundings of what they were
    rounding = 8.0 * np.finfo(np.float32).eps * LOAD * (np.abs(run.q).max() + dt * np.abs(run.qd).max())
    assert np.diff(energy, axis=0).max() <= rounding


@pytest.mark.parametrize("host", THROWN)
def test_a_reset_host_catches_as_one_just_made(host: str) -> None:
    """Reset while joints move the other way, and while they stand: no step after it knows the motion before.

    A velocity of then, of another sign or larger, would have the first step hold what it should let slide.
    """
    inertia, dt = 0.05, 0.005
    rig = THROWN[host](inertia, dt)
    wanted = thrown(rig, dt)
    slid = wanted.qd[1] < SPEEDS - 0.5 * dt * LOAD / inertia
    assert slid.all() and (wanted.qd[1] > SPEEDS - dt * (LOAD + 4.0) / inertia).all()  # of the load and 0 to 4 N·m
    for before, seconds in ((-2.0 * SPEEDS, 3.0 * dt), (SPEEDS, 0.25)):
        thrown(rig, dt, before, seconds)
        again = thrown(rig, dt)
        np.testing.assert_allclose(again.q, wanted.q, rtol=0.0, atol=1e-4 * np.abs(wanted.q).max())
        np.testing.assert_allclose(again.qd, wanted.qd, rtol=0.0, atol=1e-4 * np.abs(wanted.qd).max())
