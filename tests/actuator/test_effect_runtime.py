"""Effects in the simulator's actuator: the path of the diagnosis, nothing without effects, states by environment."""

import functools

import numpy as np
import pytest
import warp as wp

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.effect_runtime import values_row
from mrwarp.effects.catalogue import CATALOGUE, SLOTS, column_of
from mrwarp.effects.law import STRAIN_TIME
from mrwarp.effects.replay_kernel import BASE, HEAT_TIMES, effect_replay_kernel
from mrwarp.enums import Coupling, ZStep
from mrwarp.model_file import Effect, make_effect
from mrwarp.params import MrParams
from tests.actuator import actuator_bench as bench
from tests.actuator.actuator_bench import Bench, Joint, assert_bit_equal
from tests.effects.strengths import STRENGTHS

DT = 0.005
ENVS = 4
MECHANISMS = [name for name, law in CATALOGUE.items() if law.kind == "mechanism" and name != "rotor_inertia"]
"""Effects that act in the kernels; inertia acts in the model, see tests/env/test_sim.py."""


MASSLESS = {"load_friction": {"inertia": 0.0}}
"""Strengths at which nothing is multiplied with an acceleration."""


def effect(name: str) -> Effect:
    """An effect at its visible strength."""
    return make_effect(name, STRENGTHS[name])


def massless(name: str) -> Effect:
    """Parameters for :func:`replayed`, whose accelerations are made for its way: what takes one is tested by itself."""
    return make_effect(name, {**STRENGTHS[name], **MASSLESS.get(name, {})})


ALL = tuple(effect(name) for name in MECHANISMS)


LEGS = [0, 0]


class Rig(Bench):
    """An actuator with two devices on its own input arrays."""

    def __init__(
        self,
        effects: tuple[Effect, ...] = (),
        *,
        num_envs: int = ENVS,
        cfg: MrActuatorCfg | None = None,
        params: MrParams | None = None,
        mixed: bool = False,
    ) -> None:
        mr = params or MrParams()
        joints = [Joint("a", mr, effects), Joint("b", mr.replace(K1=6.0), () if mixed else effects)]
        super().__init__(num_envs, cfg, joints, legs=LEGS)


def random_inputs(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """States that open and close both gates."""
    return bench.random_inputs(rng, ENVS, LEGS)


@pytest.mark.parametrize("coupling", list(Coupling))
@pytest.mark.parametrize("z_step", list(ZStep))
def test_null_effects_are_the_plain_laws_bit_for_bit(coupling: Coupling, z_step: ZStep) -> None:
    """With every parameter at null the kernels with effects give the bits of those without."""
    cfg = MrActuatorCfg(coupling=coupling, z_step=z_step)
    null = make_effect("coil_lag", {"time_constant": 0.0})
    lagging = MrParams().replace(coil_time_constant=0.02)
    plain, extended = Rig(cfg=cfg, params=lagging), Rig((null,), cfg=cfg, params=lagging)
    assert plain.actuator.effects is None and extended.actuator.effects is not None
    rng = np.random.default_rng(1)
    for _ in range(200):
        x = random_inputs(rng)
        plain.step(**x)
        extended.step(**x)
        got, want = extended.everything(), plain.everything()
        assert_bit_equal({name: got[name] for name in want}, want)


def test_without_effects_the_plain_kernels_run() -> None:
    """No effects, effects of the log only, and an inertia alone leave the actuator the kernels of the plain laws."""
    log = make_effect("velocity_lag", {"time_constant": 0.01})
    for effects in (
        (),
        (log,),
        (make_effect("rotor_inertia", {"inertia": 0.1}),),
        (Effect(name="leak", parameters={}),),
    ):
        actuator = Rig(effects).actuator
        assert actuator.effects is None


def motion(seconds: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angle, velocity and I_e at 200 Hz as the simulator steps them: dq = dt*qd; at rest at first, and at reversals."""
    t = np.arange(0.0, seconds, DT)
    qd = 2.0 * np.sin(2.0 * np.pi * 0.9 * t) + 1.2 * np.sin(2.0 * np.pi * 2.3 * t + 0.4)
    qd[1:][qd[1:] * qd[:-1] < 0.0] = 0.0
    qd[:2] = 0.0
    current = np.clip(0.8 + 0.7 * np.sign(np.sin(2.0 * np.pi * 1.1 * t)) + 0.3 * np.sin(3.0 * t), 0.0, 1.5)
    return -1.5 + DT * np.cumsum(qd), qd, current


OPEN = MrParams().replace(eps_v=0.0, eps_hold=0.0)
"""The holding gate never opens; the dynamic gate does whenever the joint moves."""


def simulated(effects: tuple[Effect, ...]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """tau_BW, commanded current and stored heat before each step of the simulator's stages along the motion."""
    rig = Rig(effects, num_envs=1, cfg=MrActuatorCfg(z_step=ZStep.EXACT), params=OPEN)
    state = rig.actuator.effects
    assert state is not None
    samples = []
    for q, qd, current in zip(*motion(4.0), strict=True):
        heat = state.heat.numpy()[0, 0]
        # the target lies behind the joint, so that the dynamic gate opens
        rig.step(
            q=np.array(q),
            qd=np.array(qd),
            q_des=np.array(q - np.sign(qd)),
            f_foot=np.array(10.0),
            current_e=np.array(current),
        )
        samples.append((rig.actuator.tau_dyn.numpy()[0, 0], rig.actuator.coil.numpy()[0, 0], heat))
    tau, command, heat = np.array(samples).T
    return tau, command, heat


@functools.cache
def plainly() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """As :func:`simulated`, by an effect that does nothing."""
    return simulated((make_effect("coil_lag", {"time_constant": 0.0}),))


def mean_current(command: np.ndarray, lag: float) -> np.ndarray:
    """Mean over each step of the current that follows a held command with a first-order lag, from 0 A."""
    kept, begin, means = np.exp(-DT / lag), 0.0, []
    for wanted in command:
        means.append(wanted + (begin - wanted) * lag / DT * (1.0 - kept))
        begin = wanted + (begin - wanted) * kept
    return np.array(means)


def replayed(effects: tuple[Effect, ...], command: np.ndarray, heat: np.ndarray) -> np.ndarray:
    """Torque of the diagnosis' kernel, fed with the way and the command of each of the simulator's steps."""
    q, qd, _ = motion(4.0)
    count = len(q)
    # the kernel's cubic joins two velocities; this acceleration makes its way that of the newest velocity held
    qdd = -6.0 / DT * np.cumsum(np.diff(qd, prepend=0.0))
    bouc_wen = OPEN.bouc_wen
    q = q - bouc_wen.q_neutral  # the bench's angle
    values = {**dict(OPEN), "q_zero": bouc_wen.q_offset + bouc_wen.q_center}
    row = values_row(effects)
    lag = row[column_of("coil_lag", "time_constant")]
    if lag > 0.0:
        # a sample of the diagnosis is the current at its time; the simulator's torque takes the mean over the step
        late = row[column_of("command_delay", "delay")] / DT
        command = mean_current(np.interp(np.arange(count) - late, np.arange(count), command), lag)
        row[[column_of("coil_lag", "time_constant"), column_of("command_delay", "delay")]] = 0.0

    def array(x: np.ndarray) -> wp.array:
        return wp.array(np.ascontiguousarray(x, dtype=np.float32), dtype=float, device="cpu")

    tau = wp.full((1, count), float("nan"), dtype=float, device="cpu")
    inputs = [
        array(np.array([[values.get(name, 0.0) for name in BASE]])), array(row[None]), 1, 0, array(q), array(qd),
        array(command), array(qdd), array(DT * np.arange(1, count + 1)), array(DT * np.arange(1, count + 1)),
        array(np.tile(heat, (len(HEAT_TIMES), 1))), None,
        wp.array([0, count], dtype=int, device="cpu"), array(np.array([DT])), array(np.zeros(1)), array(np.zeros(1)),
    ]  # fmt: skip
    outputs = [wp.zeros((1, SLOTS), dtype=float, device="cpu"), tau]
    wp.launch(effect_replay_kernel, dim=(1, 1), inputs=inputs, outputs=outputs, device="cpu")
    return tau.numpy()[0]


def assert_same_torque(found: np.ndarray, want: np.ndarray, names: list[str]) -> None:
    """Equal to a few roundings of the largest torque; with all effects a little more in the steps that end a gap.

    There the device moves by what is left of the step, and backlash takes a gap as closed within 1e-5 of its half. Dry
    friction behind it is wound up by that way at its strength / (speed * STRAIN_TIME), 5e-4 N·m in all.
    """
    off, rounding = np.abs(found - want), 16.0 * np.finfo(np.float32).eps * max(np.abs(want).max(), 1.0)
    if "backlash" in names and len(names) > 1:
        rubs = [STRENGTHS[name] for name in names if "speed" in STRENGTHS[name]]
        stiffness = sum(
            abs(strength.get(part, 0.0)) / (strength["speed"] * STRAIN_TIME)
            for strength in rubs
            for part in ("torque", "coulomb", "F1", "F2")
        )
        assert np.mean(off > rounding) < 0.01, "gaps end in fewer steps"
        rounding += 1e-5 * STRENGTHS["backlash"]["half_gap"] * stiffness
    assert off.max() <= rounding


@pytest.mark.parametrize("names", [[name] for name in MECHANISMS] + [MECHANISMS], ids=lambda names: "+".join(names))
def test_simulated_torque_is_that_of_the_diagnosis(names: list[str]) -> None:
    """Along a prescribed motion each effect, and all together, gives the torque of the kernel that names it."""
    effects = tuple(massless(name) for name in names)
    tau, command, heat = simulated(effects)
    plain, _, _ = plainly()
    want = replayed(effects, command, heat)
    assert np.abs(tau - plain).max() > 0.02 * np.abs(want).max(), "the effect is too weak to test anything"
    assert_same_torque(tau, want, names)


def test_a_gear_carries_what_accelerates_the_load_behind_it() -> None:
    """F1*|u + J*a| with the acceleration of the last two steps."""
    strength = {"F1": 0.1, "speed": 0.05}
    plain, current, _ = plainly()
    rubs = simulated((make_effect("load_friction", strength),))[0] - plain
    found = simulated((make_effect("load_friction", {**strength, "inertia": 0.02}),))[0] - plain
    _, qd, _ = motion(4.0)
    loaded = np.flatnonzero(current > 0.1)
    want = rubs * np.abs(1.0 + 0.02 * np.diff(qd, prepend=0.0) / DT / np.maximum(current, 0.1))
    assert np.abs(want - rubs)[loaded].max() > 0.02 and len(loaded) > 300
    np.testing.assert_allclose(found[loaded], want[loaded], rtol=0, atol=1e-5)


def test_coil_lag_is_the_lag_of_the_parameters() -> None:
    """The effect gives the torque, bound and current of the joint parameter ``coil_time_constant``, bit for bit."""
    lag = make_effect("coil_lag", {"time_constant": 0.03})
    ours, theirs = Rig((lag,)), Rig(params=MrParams().replace(coil_time_constant=0.03))
    rng = np.random.default_rng(5)
    for _ in range(100):
        x = random_inputs(rng)
        ours.step(**x)
        theirs.step(**x)
        names = ("tau", "bound", "current", "z", "tau_dyn", "ledger")
        got, want = ours.everything(), theirs.everything()
        assert_bit_equal({name: got[name] for name in names}, {name: want[name] for name in names})


def test_heat_follows_its_differential_equation() -> None:
    """At constant power the heat is P*T*(1 - exp(-t/T)), to the first-order error P*dt of the step."""
    drift = make_effect("temperature_drift", {"yield_loss": 0.0, "viscosity_loss": 0.0, "time_constant": 0.5})
    still = MrParams().replace(C=0.0, D=2.0, B=0.0, K0=0.0, K1=0.0, I1=0.0, eps_v=0.0, eps_hold=0.0)
    rig = Rig((drift,), num_envs=1, params=still)
    for _ in range(100):
        rig.step(
            q=np.array(-1.5), qd=np.array(3.0), q_des=np.array(-2.5), f_foot=np.array(10.0), current_e=np.array(1.0)
        )
    assert rig.actuator.effects is not None
    power = 2.0 * 3.0 + still.coil.coil_resistance * 1.0
    heat = rig.actuator.effects.heat.numpy()[0, 0]
    assert heat == pytest.approx(power * 0.5 * (1.0 - np.exp(-1.0)), abs=power * DT)


def test_wear_counts_from_the_begin_of_the_session() -> None:
    """The loop weakens by the rate, masked resets do not renew the device, a new session does; it never pushes."""
    rig = Rig((make_effect("wear", {"rate": 1.0}),), num_envs=2, cfg=MrActuatorCfg(coupling=Coupling.EXPLICIT))
    x = {
        "q": np.array(-1.5), "qd": np.array(2.0), "q_des": np.array(-2.5), "f_foot": np.array(10.0),
        "current_e": np.array(1.5), "friction": np.array(0.0),
    }  # fmt: skip
    torque = []
    for _ in range(400):  # twice the device's life
        rig.step(**x)
        torque.append(rig.actuator.tau_mr.numpy()[0, 0])
    bare = Rig(num_envs=2, params=MrParams().replace(K0=0.0, K1=0.0), cfg=MrActuatorCfg(coupling=Coupling.EXPLICIT))
    bare.step(**x)
    assert max(torque) <= 0.0 and -torque[30] > 0.9
    np.testing.assert_allclose(torque[200:], bare.actuator.tau_mr.numpy()[0, 0], rtol=1e-5)
    assert rig.actuator.effects is not None
    device = wp.to_torch(rig.actuator.param("T_max"))
    assert float(device.min()) > 0.0  # the device's own number stays
    assert rig.everything()["effects_clock"][0] == 400
    rig.actuator.reset()
    assert rig.actuator.effects.clock.numpy()[0] == 400
    rig.actuator.begin_session()
    assert rig.actuator.effects.clock.numpy()[0] == 0


@pytest.mark.parametrize("coupling", list(Coupling))
def test_passivity_survives_all_effects(coupling: Coupling) -> None:
    """Bounds stay at or above 0, and an explicit sliding device never pushes, for any signs of the effects."""
    negative = (
        make_effect("coulomb_friction", {"torque": -3.0, "speed": 0.05}),
        make_effect("friction_asymmetry", {"coulomb": -2.0, "viscous": -0.5, "speed": 0.05}),
        make_effect("current_viscosity", {"B1": -0.5}),
        make_effect("temperature_drift", {"yield_loss": -0.01, "viscosity_loss": 0.5, "time_constant": 20.0}),
    )
    for effects in (ALL, negative):
        rig = Rig(effects, cfg=MrActuatorCfg(coupling=coupling, holding=False))
        rng = np.random.default_rng(7)
        for _ in range(100):
            x = random_inputs(rng)
            rig.step(**x)
            assert rig.actuator.bound.numpy().min() >= 0.0
            if coupling is Coupling.EXPLICIT:
                assert (rig.actuator.tau_mr.numpy() * x["qd"]).max() <= 0.0


def test_device_without_effects_beside_one_with_them_is_plain() -> None:
    """In an actuator with effects on one joint, the other joint's numbers are those of the plain laws."""
    mixed, plain = Rig(ALL, mixed=True), Rig()
    rng = np.random.default_rng(9)
    for _ in range(60):
        x = random_inputs(rng)
        mixed.step(**x)
        plain.step(**x)
    for name in ("tau", "bound", "z", "current", "tau_dyn", "m_hold"):
        got, want = mixed.everything()[name], plain.everything()[name]
        assert np.array_equal(got[:, 1], want[:, 1])
    assert not np.array_equal(mixed.everything()["tau_dyn"][:, 0], plain.everything()["tau_dyn"][:, 0])
