"""The MR joint as a Newton drive: the same torque as MrActuator, USD round trip, reset, capture, brake constraint."""

# Newton's arrays are Optional and its custom attributes dynamic; pyright cannot follow either
# pyright: reportArgumentType=false, reportAttributeAccessIssue=false, reportOptionalMemberAccess=false

import re
import warnings
from dataclasses import replace
from pathlib import Path
from typing import Any

import newton
import numpy as np
import pytest
import warp as wp

from mrwarp.actuator import brake_constraint
from mrwarp.actuator import newton_drive as drive_module
from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.mr_actuator import MrActuator
from mrwarp.actuator.newton_drive import DriveMR, apply_brake_bounds, drive_inputs, prepare_brake
from mrwarp.enums import Coupling, HoldCurrent, ZStep
from mrwarp.kernels.mr_joint import FIELDS
from mrwarp.model_file import Effect, FittedOn, Model, Parameter, make_effect, save_model
from mrwarp.params import MrParams, ParameterError
from mrwarp.usd.asset import JointActuator, load_bench
from mrwarp.usd.open_stage import ASSETS
from tests.actuator.actuator_bench import make_inputs
from tests.actuator.test_effect_runtime import effect

ORIGIN = FittedOn(source="bench", trajectories=3, samples=2000, rate=200.0)
DT = 0.005
INERTIA = 0.2
NUM = 5
PRIM = "/mr_bench/actuators/bench_joint"


def scene(num: int = NUM, per_joint: dict[str, np.ndarray] | None = None, **params: Any) -> newton.Model:
    """``num`` worlds of one revolute joint about z with an MR drive; ``per_joint`` holds one value per joint."""
    builder = newton.ModelBuilder()
    for k in range(num):
        builder.begin_world()
        body = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * INERTIA))
        joint = builder.add_joint_revolute(parent=-1, child=body, axis=(0.0, 0.0, 1.0), armature=0.0)
        builder.add_articulation([joint])
        own = {name: float(values[k]) for name, values in (per_joint or {}).items()}
        builder.add_actuator(DriveMR, index=builder.joint_qd_start[joint], **params, **own)
        builder.end_world()
    return builder.finalize(device="cpu")


class Rig:
    """One actuator with its two states, stepped on arrays that the test writes."""

    def __init__(self, model: newton.Model) -> None:
        (self.actuator,) = model.actuators
        self.drive: DriveMR = self.actuator.drive
        self.state, self.control = model.state(), model.control()
        self.inputs = drive_inputs(self.actuator, self.control)
        self.now, self.after = self.actuator.state(), self.actuator.state()

    def write(self, **arrays: np.ndarray) -> None:
        """Overwrite inputs by name: q, qd, q_des, current, f_foot."""
        state, control = self.state, self.control
        target = {
            "q": state.joint_q, "qd": state.joint_qd, "q_des": control.joint_target_q,
            "current": self.inputs.mr_current, "f_foot": self.inputs.mr_foot_load,
        }  # fmt: skip
        for name, values in arrays.items():
            target[name].assign(np.asarray(values, dtype=np.float32))

    def step(self) -> np.ndarray:
        """One torque step; returns the effort [N·m], shape (N,)."""
        self.launch()
        return self.control.joint_f.numpy().copy()

    def launch(self) -> None:
        """The launches of one torque step."""
        self.control.joint_f.zero_()
        self.actuator.step(self.state, self.control, self.now, self.after, dt=DT)
        self.now, self.after = self.after, self.now


def trajectory(seed: int, steps: int, num: int = NUM) -> dict[str, np.ndarray]:
    """Random inputs, shape (steps, num), that open and close both gates."""
    rng = np.random.default_rng(seed)
    shape = (steps, num)
    q_des = rng.uniform(-2.0, -1.0, shape)
    return {
        "q_des": q_des,
        "q": q_des + rng.uniform(-0.5, 0.5, shape),
        "qd": rng.choice([0.05, 1.0, 8.0], shape) * rng.standard_normal(shape),
        "f_foot": rng.choice([0.0, 50.0], shape),
        "current": rng.uniform(0.0, 2.0, shape),
    }


def reference(
    model: newton.Model, cfg: MrActuatorCfg, per_joint: dict[str, np.ndarray], effects: tuple[Effect, ...] = ()
) -> MrActuator:
    """MrActuator with one environment per joint and the same parameters."""
    mr = MrParams()
    joint = JointActuator(
        joint="j",
        prim_path="",
        kp=mr.motor.kp_base,
        kd=mr.motor.kd,
        tau_limit=mr.motor.tau_limit,
        mr=mr,
        model=Model(parameters={}, fitted_on=ORIGIN, effects=effects),
    )
    inputs = make_inputs(model.joint_dof_count, 1)
    actuator = MrActuator([joint], [0], inputs, dt=DT, cfg=cfg, share_params=False)
    for name, values in per_joint.items():
        actuator.set_param(name, values.reshape(-1, 1))
    return actuator


@pytest.mark.parametrize(
    ("coupling", "hold_current", "z_step"),
    [
        (Coupling.EXPLICIT, HoldCurrent.SUPPORT, ZStep.EULER),
        (Coupling.EXPLICIT, HoldCurrent.FIXED, ZStep.EXACT),
        (Coupling.CONSTRAINT, HoldCurrent.SUPPORT, ZStep.EULER),
    ],
)
def test_drive_equals_actuator(coupling: Coupling, hold_current: HoldCurrent, z_step: ZStep) -> None:
    """Same inputs, 200 steps: effort and brake bound equal MrActuator's to 2 float32 roundings of their size."""
    rng = np.random.default_rng(0)
    per_joint = {
        "K1": rng.uniform(5.0, 15.0, NUM),
        "T_max": rng.uniform(10.0, 30.0, NUM),
        "coil_time_constant": np.array([0.0, 0.002, 0.01, 0.0, 0.05]),
    }
    choices = {"coupling": coupling, "hold_current": hold_current, "z_step": z_step}
    model = scene(per_joint=per_joint, **choices)
    rig, other = Rig(model), reference(model, MrActuatorCfg(**choices), per_joint)
    inputs = trajectory(1, 200)
    gates = np.zeros(3, dtype=int)
    for k in range(200):
        now = {name: values[k] for name, values in inputs.items()}
        rig.write(**now)
        rig.drive.brake_bound.fill_(float("nan"))
        for name in ("q_des", "q", "qd", "f_foot"):
            getattr(other.inputs, name).assign(now[name].astype(np.float32).reshape(-1, 1))
        other.inputs.current_e.assign(now["current"].astype(np.float32))
        tau = rig.step()
        other.step()
        np.testing.assert_allclose(tau, other.tau.numpy()[:, 0], rtol=3e-7, atol=1e-5)
        np.testing.assert_allclose(rig.drive.brake_bound.numpy(), other.bound.numpy()[:, 0], rtol=3e-7, atol=1e-5)
        m_dyn, m_hold = other.m_dyn.numpy(), other.m_hold.numpy()
        gates += [int(m_dyn.sum()), int(m_hold.sum()), int((m_dyn + m_hold == 0.0).sum())]
    assert gates.min() > 50, f"trajectory opens the gates too rarely: {gates}"
    assert rig.now.drive_state is not None
    np.testing.assert_allclose(rig.now.drive_state.z.numpy(), other.z.numpy()[:, 0], rtol=3e-7, atol=1e-6)


def test_feedforward_and_target_velocity() -> None:
    """The motor's torque is clip(kp*e + kd*(qd_des - qd) + feed-forward, +-tau_limit); the device rests at qd = 0."""
    rig = Rig(scene(num=2, kp_base=10.0, kd=0.5, tau_limit=4.0, q_neutral=0.0))
    rig.control.joint_target_q.fill_(0.1)
    rig.control.joint_target_qd.fill_(2.0)
    rig.control.joint_act.assign(np.array([-1.5, 30.0], dtype=np.float32))
    np.testing.assert_allclose(rig.step(), [10.0 * 0.1 + 0.5 * 2.0 - 1.5, 4.0], rtol=1e-6)


@pytest.mark.parametrize(
    ("given", "said"),
    [
        *(
            ({name: -3.0}, r"K1 = -3 is out of range; allowed: 0 to 1e\+15 N·m/\(rad·A\)")
            for name in ("K1", "mr:k1", "newton:mr:K1")
        ),
        ({"K11": 1.0}, "did you mean 'K1'"),
        ({"coupling": "hard"}, "coupling = 'hard'; allowed: 'explicit', 'constraint'"),
    ],
)
def test_refused_arguments(given: dict[str, Any], said: str) -> None:
    """In Python's and in USD's spelling, with the range, the nearest name or the choices."""
    with pytest.raises(ParameterError, match=said):
        scene(num=1, **given)


def test_defaults_fill_the_rest() -> None:
    """Of what is given in USD's spelling."""
    resolved = DriveMR.resolve_arguments({"mr:t_max": 20.0, "coupling": "constraint"})
    assert resolved["T_max"] == 20.0 and resolved["coupling"] is Coupling.CONSTRAINT
    assert {name: resolved[name] for name in FIELDS} == MrParams().replace(T_max=20.0).to_dict()


def test_missing_inputs_are_refused() -> None:
    """Without mr_current, and without dt, the message says what to pass."""
    rig = Rig(scene(num=1))
    with pytest.raises(ValueError, match="needs its states and dt"):
        rig.actuator.step(rig.state, rig.control, rig.now, rig.after)
    rig.inputs.mr_current = None
    with pytest.raises(ValueError, match=r"needs \w+.mr_current"):
        rig.step()


def test_bench_asset_gives_its_parameters() -> None:
    """Newton reads every number of mr_bench.usda, and an edit of K1 on the stage, into the drive."""
    asset = load_bench()
    asset.stage.GetPrimAtPath(PRIM).GetAttribute("newton:mr:K1").Set(12.5)
    builder = newton.ModelBuilder()
    with warnings.catch_warnings():
        warnings.simplefilter("error", UserWarning)  # Newton's about arguments that it ignores is one
        builder.add_usd(asset.stage)
    drive = Rig(builder.finalize(device="cpu")).drive
    (joint,) = asset.actuators
    assert joint.mr is not None
    for name, value in joint.mr.replace(K1=12.5):
        np.testing.assert_array_equal(drive.param(name).numpy(), np.float32(value), err_msg=name)


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ("newton:mr:K1 = ", "newton:mr:K1 = -", "K1 = -10.4133 is out of range; allowed: 0 to 1e\\+15"),
        ("newton:mr:K1", "newton:mr:K_1", "K1 is missing; allowed: 0 to 1e\\+15"),
    ],
)
def test_bad_usd_is_refused_with_its_prim(old: str, new: str, message: str, tmp_path: Path) -> None:
    """A prim with a bad or misspelt number is refused by Newton's own loader, with path and range."""
    text = (ASSETS / "mr_bench.usda").read_text(encoding="utf-8")
    assert text.count(old) == 1
    file = tmp_path / "bench.usda"
    file.write_text(text.replace(old, new), encoding="utf-8")
    with pytest.raises(ValueError, match=f"{PRIM}.*{message}"):
        newton.ModelBuilder().add_usd(str(file))


def test_register_twice_is_silent() -> None:
    """A second registration changes and warns nothing."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        drive_module.register()


def test_masked_reset() -> None:
    """Masked actuators forget stress and current; the others stay bit-equal."""
    rig = Rig(scene())
    for k in range(20):
        rig.write(**{name: values[k] for name, values in trajectory(2, 20).items()})
        rig.step()
    state = rig.now.drive_state
    state.current.assign(np.linspace(0.1, 0.5, NUM).astype(np.float32))
    before = {name: getattr(state, name).numpy().copy() for name in ("z", "current")}
    assert (before["z"] != 0.0).all()
    mask = np.array([True, False, True, False, False])
    rig.now.reset(wp.array(mask, dtype=wp.bool, device="cpu"))
    for name, values in before.items():
        np.testing.assert_array_equal(getattr(state, name).numpy(), np.where(mask, np.float32(0.0), values))
    with pytest.raises(ValueError, match="need bool of shape"):
        rig.now.reset(wp.array(mask[:2], dtype=wp.bool, device="cpu"))


def test_state_is_double_buffered() -> None:
    """A step leaves the state that it read alone; Newton's State.assign, for captured odd loops, copies all of it."""
    rig = Rig(scene())
    rig.write(**{name: values[0] for name, values in trajectory(3, 1).items()})
    rig.step()
    assert not rig.after.drive_state.z.numpy().any() and rig.now.drive_state.z.numpy().all()
    rig.after.assign(rig.now)
    for name in ("z", "current"):
        np.testing.assert_array_equal(
            getattr(rig.after.drive_state, name).numpy(), getattr(rig.now.drive_state, name).numpy()
        )


def test_capture_equals_eager() -> None:
    """20 replays of two captured steps give bit for bit the efforts and states of 40 eager steps."""
    inputs = trajectory(4, 20)
    eager, captured = Rig(scene(coil_time_constant=0.01)), Rig(scene(coil_time_constant=0.01))
    assert captured.actuator.is_graphable()
    with wp.ScopedCapture(device="cpu") as capture:
        captured.launch()
        captured.launch()
    captured.now.reset()
    captured.after.reset()
    for k in range(20):
        now = {name: values[k] for name, values in inputs.items()}
        eager.write(**now)
        captured.write(**now)
        eager.step()
        tau = eager.step()
        wp.capture_launch(capture.graph)
        np.testing.assert_array_equal(captured.control.joint_f.numpy(), tau)
    for name in ("z", "current"):
        np.testing.assert_array_equal(
            getattr(captured.now.drive_state, name).numpy(), getattr(eager.now.drive_state, name).numpy()
        )


def slip(load: float, current: float, gated: bool, steps: int) -> np.ndarray:
    """Speed [rad/s] of a joint that slips, shape (steps,): Euler steps under the load and eqs. 14, 15, in float64."""
    p, gate = MrParams().bouc_wen, MrParams().gate
    q, qd, z, speeds = 0.0, 0.0, 0.0, []
    for _ in range(steps):
        held = abs(qd) < gate.eps_hold
        z += DT * (qd - p.beta * abs(qd) * z - p.gamma * qd * abs(z))
        flowing = 0.0 if gated and not held and abs(q) <= gate.eps_e else current
        bound = abs(
            p.D + p.B * qd + p.C * (q - p.q_offset) + p.I1 * flowing + (p.K0 + p.K1 * flowing) / (1 + p.alpha * qd) * z
        )
        qd += DT / INERTIA * (load - max(bound, yield_torque(current) if held else 0.0))
        q += DT * qd
        speeds.append(qd)
    return np.array(speeds)


def yield_torque(current: float) -> float:
    """tau_y of eq. 18 [N·m]."""
    hold = MrParams().hold
    return hold.T_max * current**hold.n / (hold.K**hold.n + current**hold.n)


def loaded_speeds(load: np.ndarray, current: float, f_foot: float | None, steps: int) -> np.ndarray:
    """Speeds [rad/s] of braked joints without a motor under torques [N·m], shape (steps, joints)."""
    motor_off = {"kp_base": 0.0, "kp_low": 0.0, "kd": 0.0, "tau_limit": 100.0, "q_neutral": 0.0}
    model = scene(num=len(load), coupling="constraint", hold_current="fixed", **motor_off)
    rig = Rig(model)
    solver = newton.solvers.SolverMuJoCo(model)
    rig.inputs.mr_current.fill_(current)
    rig.control.joint_act.assign(load.astype(np.float32))
    rig.inputs.mr_foot_load = None if f_foot is None else wp.full(len(load), f_foot, dtype=float, device="cpu")
    other = model.state()
    speeds = []
    for _ in range(steps):
        rig.launch()
        apply_brake_bounds(solver, rig.actuator, DT)
        solver.step(rig.state, other, rig.control, None, DT)
        rig.state, other = other, rig.state
        speeds.append(rig.state.joint_qd.numpy().copy())
    return np.array(speeds)


@pytest.mark.parametrize("f_foot", [None, 50.0])
def test_brake_holds_below_yield_and_slips_above(f_foot: float | None) -> None:
    """Under 90 % of tau_y(I) the joint creeps as predicted, below 1e-3 rad/s; under 110 % it slips as predicted.

    Creep of MuJoCo's friction row with damping 1/dt: qd = dt*R*tau with R = (1 - imp)/imp * invweight, invweight = 1/J.
    """
    current, steps = 0.5, 40
    load = np.array([0.9, 1.1]) * yield_torque(current)
    held, slipping = loaded_speeds(load, current, f_foot, steps).T
    creep = brake_constraint.CREEP * load[0]
    assert np.abs(held).max() < 1e-3
    np.testing.assert_allclose(held[-1], creep, rtol=0.02)
    # below 12.1 rad/s the Euler step of z amplifies no rounding
    assert 5.0 < slipping[-1] < 12.0
    np.testing.assert_allclose(slipping, slip(load[1], current, f_foot is not None, steps), rtol=1e-3)


def test_brake_needs_its_coupling_and_its_backend() -> None:
    """An explicit drive has no bound to apply, MuJoCo C no arrays, a capture no time; line searches become 30."""
    model = scene(num=1)
    rig = Rig(model)
    solver = newton.solvers.SolverMuJoCo(model, ls_iterations=20)
    with pytest.raises(ValueError, match="no brake bound"):
        apply_brake_bounds(solver, rig.actuator, DT)
    rig.drive.coupling = Coupling.CONSTRAINT
    with pytest.raises(ValueError, match="use_mujoco_cpu=False"):
        prepare_brake(newton.solvers.SolverMuJoCo(model, use_mujoco_cpu=True), rig.actuator, DT)
    with wp.ScopedCapture(device="cpu"), pytest.raises(ValueError, match="before the capture"):
        apply_brake_bounds(solver, rig.actuator, DT)
    prepare_brake(solver, rig.actuator, DT)
    assert solver.mjw_model.opt.ls_iterations == 30
    model.joint_friction.fill_(0.25)
    rig.drive.brake_bound.fill_(3.0)
    apply_brake_bounds(solver, rig.actuator, DT)
    np.testing.assert_array_equal(solver.mjw_model.dof_frictionloss.numpy(), [[3.25]])


def model_file(
    path: Path, effects: tuple[Effect, ...], current: tuple[float, float] | None = None, **values: float
) -> Path:
    """A model.json with effects, and other numbers than the paper's."""
    laws = ("D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma", "q_offset", "q_center", "T_max", "K", "n")
    values = {**{name: MrParams().to_dict()[name] for name in laws}, **values}
    parameters = {name: Parameter(value=value, unit=MrParams.spec(name).unit) for name, value in values.items()}
    origin = replace(ORIGIN, current=current)
    return save_model(Model(parameters=parameters, fitted_on=origin, effects=effects), path)


def fitted_scene(path: Path, num: int, **arguments: Any) -> newton.Model:
    """``num`` worlds of one joint with the device of a model file."""
    builder = newton.ModelBuilder()
    for _ in range(num):
        builder.begin_world()
        joint = builder.add_joint_revolute(
            parent=-1,
            child=builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3) * INERTIA)),
            axis=(0.0, 0.0, 1.0),
            armature=0.03,
        )
        builder.add_articulation([joint])
        DriveMR.from_model(path, builder, index=builder.joint_qd_start[joint], **arguments)
        builder.end_world()
    return builder.finalize(device="cpu")


def test_inertia_of_a_model_file_is_armature(tmp_path: Path) -> None:
    """A rotor's inertia joins the joint's armature; one that leaves none is refused, with both numbers' place."""
    path = model_file(tmp_path / "model.json", (make_effect("rotor_inertia", {"inertia": 0.02}),))
    np.testing.assert_allclose(fitted_scene(path, 2).joint_armature.numpy(), 0.05, rtol=1e-6)
    path = model_file(tmp_path / "less.json", (make_effect("rotor_inertia", {"inertia": -0.04}),))
    with pytest.raises(ValueError, match=r"less\.json: its rotor_inertia .* armature of -0.01"):
        fitted_scene(path, 1)


def test_current_of_a_model_file_is_limited_to_what_was_measured(tmp_path: Path) -> None:
    """A bench that went up to 0.3 A gives a coil of 0.3 A, unless the rest is asked for."""
    path = model_file(tmp_path / "model.json", (), current=(0.0, 0.3))
    (measured,), (asked,) = fitted_scene(path, 1).actuators, fitted_scene(path, 1, extrapolate=True).actuators
    assert measured.drive.param("current_max").numpy() == np.float32(0.3)
    assert asked.drive.param("current_max").numpy() == np.float32(1.5)


def test_the_documented_scene_runs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The examples of docs/integrations.md as they stand there: the more current, the less far a pendulum swings."""
    page = (Path(__file__).parents[2] / "docs" / "integrations.md").read_text(encoding="utf-8")
    scene_code, fitted_code = re.findall(r"```python\n(.*?)```", page, re.DOTALL)
    monkeypatch.chdir(tmp_path)
    model_file(tmp_path / "model.json", (effect("cogging"),))
    names: dict[str, Any] = {}
    exec(compile(scene_code.replace("finalize()", "finalize(device='cpu')"), "docs/integrations.md", "exec"), names)
    angle = names["angle"]
    assert np.all(np.diff(angle) < -0.03)
    assert 1.5 < angle[-1] < angle[0] < 2.6
    exec(compile(fitted_code.replace("finalize()", "finalize(device='cpu')"), "docs/integrations.md", "exec"), names)
    (actuator,) = names["model"].actuators
    assert "memory" in vars(actuator.state().drive_state)


def test_a_fitted_device_brings_no_motor(tmp_path: Path) -> None:
    """A pendulum whose device bears nothing swings as the closed form says: from level to level on the other side.

    The file holds a motor's gains, as an exported joint's does. Gains that are asked for are there.
    """
    nothing = dict.fromkeys(("D", "B", "C", "I1", "K0"), 0.0)
    path = model_file(tmp_path / "model.json", (), **nothing, kp_base=35.0, kd=0.6)
    builder = newton.ModelBuilder()
    arm = builder.add_link(mass=2.0, inertia=wp.mat33(np.eye(3) * 0.02))
    away = wp.transform((-0.2, 0.0, 0.0), wp.quat_identity())  # of the joint, from the centre of mass
    joint = builder.add_joint_revolute(parent=-1, child=arm, axis=(0.0, 1.0, 0.0), child_xform=away)
    builder.add_articulation([joint])
    DriveMR.from_model(path, builder, index=builder.joint_qd_start[joint])
    model = builder.finalize(device="cpu")
    solver, (actuator,) = newton.solvers.SolverMuJoCo(model), model.actuators
    state, after, control = model.state(), model.state(), model.control()
    now, then = actuator.state(), actuator.state()
    drive_inputs(actuator, control).mr_foot_load = None
    dt, angles, speeds = 0.002, [], []
    for _ in range(320):  # half a swing takes 1.18*pi*sqrt((I + m*l^2)/(m*g*l)) = 0.59 s
        control.joint_f.zero_()
        actuator.step(state, control, now, then, dt=dt)
        now, then = then, now
        assert control.joint_f.numpy()[0] == 0.0
        solver.step(state, after, control, None, dt)
        state, after = after, state
        angles.append(abs(state.joint_q.numpy()[0]))
        speeds.append(abs(state.joint_qd.numpy()[0]))
    fastest = np.sqrt(2.0 * 2.0 * 9.81 * 0.2 / (0.02 + 2.0 * 0.2**2))  # m*g*l = (I + m*l^2)*w^2/2
    np.testing.assert_allclose(max(speeds), fastest, rtol=0.01)  # a step of the semi-implicit Euler is w*dt = 0.5 %
    np.testing.assert_allclose(max(angles), np.pi, rtol=0.01)

    asked = newton.ModelBuilder()
    joint = asked.add_joint_revolute(parent=-1, child=asked.add_link(mass=1.0, inertia=wp.mat33(np.eye(3))))
    asked.add_articulation([joint])
    DriveMR.from_model(path, asked, index=asked.joint_qd_start[joint], kp_base=20.0, kd=0.5)
    (actuator,) = asked.finalize(device="cpu").actuators
    gains = [float(actuator.drive.param(name).numpy()[0]) for name in ("kp_base", "kp_low", "kd")]
    assert gains == [20.0, 5.0, 0.5]
