"""One device in every host: the same torque along a motion, and thrown joints are caught at any step.

mjlab's hosts run in its own environment, `make test-mjlab`, and are skipped elsewhere.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
import pytest
import warp as wp

from benchmarks import hosts
from benchmarks.host_cases import NEUTRAL, NUMBERS, STRENGTHS, case, device
from benchmarks.host_rigs import joint_batch, mjlab_arms
from benchmarks.hosts import HOSTS, Host
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.effects.catalogue import CATALOGUE, HYSTERESIS
from mrwarp.enums import BackendKind, Coupling
from mrwarp.model_file import save_model
from mrwarp.mujoco import Brake
from mrwarp.params import MrParams

SHARES = [pytest.param(host, id=host.name.replace("`", "")) for host in HOSTS]


def test_the_matrix_has_every_law() -> None:
    """A law that joins the list joins the matrix."""
    assert set(NUMBERS) == {"bouc_wen", *HYSTERESIS}
    assert {name for names in hosts.GROUPS.values() for name in names} == set(STRENGTHS)
    assert all(CATALOGUE[name].kind == "mechanism" for name in STRENGTHS)


@pytest.mark.parametrize("host", SHARES)
def test_a_host_gives_the_torque_of_joint_batch(host: Host) -> None:
    """Along motions that reverse, rest and are reset in the middle, within the bound that the page states."""
    if host.missing:
        pytest.skip(f"{host.name} needs {host.missing}; mjlab has an environment of its own: make test-mjlab")
    for row, gaps in hosts.measured([host], hosts.rows(every=False)).items():
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


def stepped(q: np.ndarray, qd: np.ndarray, dt: float, step: Callable[[], tuple[np.ndarray, np.ndarray]]) -> Thrown:
    """A quarter of a second."""
    states = [(q, qd), *(tuple(np.array(x, dtype=float) for x in step()) for _ in range(round(0.25 / dt)))]
    return Thrown(*(np.array(x) for x in zip(*states, strict=True)))


def thrown_batch(inertia: float, dt: float) -> Thrown:
    """``JointBatch`` and a plant of its own: semi-implicit Euler with the dry friction that it bounds."""
    joints, q, qd = JointBatch(num=20, dt=dt), np.zeros(20), SPEEDS.copy()

    def step() -> tuple[np.ndarray, np.ndarray]:
        nonlocal q, qd
        joints.step(q, qd, CURRENT)
        free = qd - dt * LOAD / inertia
        bound = joints.bound()
        qd = free + dt / inertia * np.clip(-free * inertia / dt, -bound, bound)
        q = q + dt * qd
        return q, qd

    return stepped(q, qd, dt, step)


def thrown_brakes(inertia: float, dt: float) -> Thrown:
    """Twenty brakes in one model of plain MuJoCo."""
    size = f'diaginertia="{inertia} {inertia} {inertia}"'
    bodies = "".join(
        f'<body><joint name="j{k}" axis="0 1 0"/><inertial pos="0 0 0" mass="1" {size}/></body>' for k in range(20)
    )
    text = f'<mujoco><option timestep="{dt}" gravity="0 0 0"/><worldbody>{bodies}</worldbody></mujoco>'
    model = mujoco.MjModel.from_xml_string(text)
    data = mujoco.MjData(model)
    brakes = [Brake(model, data, k) for k in range(20)]
    data.qvel[:], data.qfrc_applied[:] = SPEEDS, -LOAD

    def step() -> tuple[np.ndarray, np.ndarray]:
        for brake in brakes:
            brake.step(CURRENT)
        mujoco.mj_step(model, data)
        return data.qpos.copy(), data.qvel.copy()

    return stepped(np.zeros(20), SPEEDS, dt, step)


def thrown_drive(inertia: float, dt: float) -> Thrown:
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
    scenes[0].joint_qd.assign(SPEEDS.astype(np.float32))

    def step() -> tuple[np.ndarray, np.ndarray]:
        control.joint_f.zero_()
        actuator.step(scenes[0], control, *states, dt=dt)
        states.reverse()
        apply_brake_bounds(solver, actuator, dt)
        solver.step(scenes[0], scenes[1], control, None, dt)
        scenes.reverse()
        return scenes[0].joint_q.numpy(), scenes[0].joint_qd.numpy()

    return stepped(np.zeros(20), SPEEDS, dt, step)


def thrown_environment(inertia: float, dt: float, backend: BackendKind | None = None) -> Thrown:
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
    robot.reset(qvel=wp.array(SPEEDS[:, None], dtype=float, device="cpu"))
    robot.current_e.fill_(CURRENT)
    Load(robot).set(np.full(20, -LOAD))

    def step() -> tuple[np.ndarray, np.ndarray]:
        robot.step()
        return robot.sim.q.numpy()[:, 0], robot.sim.qd.numpy()[:, 0]

    return stepped(np.zeros(20), SPEEDS, dt, step)


def thrown_warp(inertia: float, dt: float) -> Thrown:
    """That joint on MuJoCo-Warp."""
    return thrown_environment(inertia, dt, BackendKind.MJWARP)


def thrown_mjlab(inertia: float, dt: float) -> Thrown:
    """mjlab's actuator and solver."""
    pytest.importorskip("mjlab", reason="mjlab has an environment of its own: make test-mjlab")
    import torch

    rig = mjlab_arms(20, dt, inertia=inertia, effort_limit=2.0 * LOAD)
    robot = rig.scene["robot"]
    robot.write_joint_velocity_to_sim(torch.tensor(SPEEDS, dtype=torch.float)[:, None])
    robot.set_joint_effort_target(torch.full((20, 1), -LOAD))
    rig.actuator.current[:] = CURRENT
    rig.scene.update(dt)

    def step() -> tuple[np.ndarray, np.ndarray]:
        rig.scene.write_data_to_sim()
        rig.sim.step()
        rig.scene.update(dt)
        return robot.data.joint_pos[:, 0].numpy().copy(), robot.data.joint_vel[:, 0].numpy().copy()

    return stepped(np.zeros(20), SPEEDS, dt, step)


THROWN = {
    "JointBatch": thrown_batch,
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
    run = THROWN[host](inertia, dt)
    assert (np.abs(run.qd[-1]) < 3e-4).all()
    least, most = (inertia * SPEEDS**2 / (2.0 * (LOAD + drag)) for drag in (4.0, 0.0))
    step = SPEEDS * dt + LOAD * dt**2 / inertia
    assert (least - step <= run.q[-1]).all() and (run.q[-1] <= most + step).all()
    energy = 0.5 * inertia * run.qd**2 + LOAD * run.q
    # angles of 32 bits, and velocities that stop at a few roundings of what they were
    rounding = 8.0 * np.finfo(np.float32).eps * LOAD * (np.abs(run.q).max() + dt * np.abs(run.qd).max())
    assert np.diff(energy, axis=0).max() <= rounding
