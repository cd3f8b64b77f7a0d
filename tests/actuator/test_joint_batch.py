"""JointBatch: the simulator's joint without a robot, in and out as NumPy, torch or Warp."""

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest
import torch
import warp as wp

from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.bench.bench_effects import Effects
from mrwarp.bench.virtual_bench import BenchCfg, run_bench
from mrwarp.identify.replay import simulate
from mrwarp.model_file import (
    Model,
    ModelFileError,
    make_effect,
    save_model,
)
from mrwarp.params import MrParams
from tests.effects.strengths import STRENGTHS
from tests.models import paper_model

DT = 0.005


def motion(steps: int, shape: tuple[int, ...], seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, velocities and currents, time first."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(steps).reshape(-1, *[1] * len(shape))
    w, a = rng.uniform(3.0, 9.0, shape), rng.uniform(0.1, 0.5, shape)
    current = np.broadcast_to(rng.uniform(0.0, 1.5, shape), (steps, *shape))
    return a * np.sin(w * t), a * w * np.cos(w * t), current


def brake(**values: float) -> Model:
    """A model file's content: the paper's numbers but for these, with a coil that lags and a rotor."""
    effects = (make_effect("coil_lag", {"time_constant": 0.02}), make_effect("rotor_inertia", {"inertia": 0.01}))
    return paper_model(*effects, more=("T_max", "K", "n"), **values)


def test_it_gives_the_torque_of_the_replay() -> None:
    """Step by step along a recording it is what identification simulates with the exact step, to float32 rounding."""
    cfg = BenchCfg(trajectories=3, samples=1500, evaluation_samples=0, effects=Effects.defaults(0.0))
    run = run_bench(cfg).fit
    params = {**MrParams().to_dict(), "q_neutral": 0.0}
    for trajectory, wanted in zip(run.trajectories, simulate(params, run, exact=True, substeps=0), strict=True):
        joint = JointBatch(dt=DT)
        got = [
            joint.step(*(np.array([x[k]]) for x in (trajectory.q, trajectory.qd, trajectory.current)))[0]
            for k in range(len(wanted))
        ]
        scale = np.abs(wanted).max()
        np.testing.assert_allclose(got, wanted, rtol=0.0, atol=64 * np.finfo(np.float32).eps * scale)


def test_numpy_torch_and_warp_give_the_same_bits() -> None:
    """Shapes in and out agree, shape (N,) and (N, joints); a joint of a batch is the joint alone."""
    q, qd, current = motion(30, (3, 4))
    model = brake(K1=7.0)
    batches = {kind: JointBatch(model, 3, joints=4, dt=DT) for kind in ("numpy", "torch", "warp")}
    alone = JointBatch(model, dt=DT)
    assert alone.inertia == pytest.approx(0.01)
    out = np.zeros((3, 4), dtype=np.float32)
    for k in range(30):
        found = batches["numpy"].step(q[k], qd[k], current[k])
        in_torch = batches["torch"].step(*(torch.from_numpy(x[k].copy()) for x in (q, qd, current)))
        in_warp = batches["warp"].step(*(wp.array(x[k], dtype=float, device="cpu") for x in (q, qd, current)))
        single = alone.step(*(x[k, 1, 2:3] for x in (q, qd, current)), out=out[0, :1])
        assert isinstance(in_torch, torch.Tensor) and isinstance(in_warp, wp.array)
        np.testing.assert_array_equal(in_torch.numpy(), found)
        np.testing.assert_array_equal(in_warp.numpy(), found)
        assert single[0] == out[0, 0] == found[1, 2]
    assert found.shape == (3, 4) and np.abs(found).min() > 1e-3


def test_reset_and_state_leave_the_other_joints_alone() -> None:
    """A masked reset: the others keep every bit, the reset ones begin again; a restored batch goes on bit-equal."""
    q, qd, current = motion(60, (4,), seed=1)
    model = brake()
    plain, reset, restored = (JointBatch(model, 4, dt=DT) for _ in range(3))
    for k in range(40):
        for batch in (plain, reset):
            batch.step(q[k], qd[k], current[k])
    restored.load_state(plain.state())
    reset.reset(np.array([False, True, False, False]))
    fresh = JointBatch(model, 4, dt=DT)
    for k in range(40, 60):
        wanted = plain.step(q[k], qd[k], current[k])
        np.testing.assert_array_equal(restored.step(q[k], qd[k], current[k]), wanted)
        got, new = reset.step(q[k], qd[k], current[k]), fresh.step(q[k], qd[k], current[k])
        np.testing.assert_array_equal(got[[0, 2, 3]], wanted[[0, 2, 3]])
        assert got[1] == new[1] != wanted[1]


def test_the_bound_is_the_yield_torque_at_rest_and_the_torque_while_sliding() -> None:
    """Eq. 18 below eps_hold, the magnitude of the torque above it; a weaker coil's current is cut."""
    model = replace(brake(), effects=())
    joints = JointBatch(model.to_params().replace(current_max=0.5), 3, dt=DT)
    torque = joints.step(0.0, np.array([0.0, 3.0, -3.0]), 1.5)
    hold = MrParams().hold
    held = hold.T_max * 0.5**hold.n / (hold.K**hold.n + 0.5**hold.n)
    np.testing.assert_allclose(joints.bound(), [held, torque[1], -torque[2]], rtol=1e-5)


def test_a_joint_that_turns_round_is_held_until_it_stands() -> None:
    """Before a turn that the last velocities promise, after it while it slows down, and not while it speeds up."""
    speeds = [3.0, 2.9, 1.2, -0.8, -0.5, -0.4, -0.9, -1.8, -1.7, 0.1, 2.0, -2.0, -2.1]
    holds = [0, 0, 1, 1, 1, 1, 0, 0, 0, 1, 0, 1, 0]
    joints, never = JointBatch(dt=DT), JointBatch(MrParams().replace(eps_hold=0.0), dt=DT)
    most = MrParams().hold.yield_torque(1.0)
    for k, (qd, held) in enumerate(zip(speeds, holds, strict=True)):
        torque = joints.step(0.0, qd, 1.0)
        assert joints.bound()[0] == pytest.approx(most if held else abs(torque[0]), rel=1e-5), k
        torque = never.step(0.0, qd, 1.0)
        assert never.bound()[0] == pytest.approx(abs(torque[0]), rel=1e-5), k
    joints.reset()
    joints.step(0.0, 1.0, 1.0)
    assert joints.bound()[0] < 0.5 * most  # nothing before counts


def test_every_form_of_a_device_is_the_same(tmp_path: Path) -> None:
    """A path, a name of the library, a model and what holds one; what is none is refused by its type."""
    model, file = brake(K1=7.0), tmp_path / "model.json"
    save_model(model, file)
    wanted = JointBatch(model, dt=DT).step(0.0, 1.0, 0.5)
    for form in (file, str(file), SimpleNamespace(model=model)):
        np.testing.assert_array_equal(JointBatch(form, dt=DT).step(0.0, 1.0, 0.5), wanted)
    assert JointBatch("paper", dt=DT).step(0.0, 1.0, 0.5) == pytest.approx(JointBatch(dt=DT).step(0.0, 1.0, 0.5), 1e-5)
    with pytest.raises(TypeError, match="dict is no device; give a model.json"):
        JointBatch({"K1": 7.0}, dt=DT)
    with pytest.raises(ModelFileError, match="came to no model"):
        JointBatch(SimpleNamespace(model=None), dt=DT)


BAD: list[tuple[dict, dict, str]] = [
    ({"num": 2.0}, {}, "num = 2.0 must be a whole number"),
    ({"num": 0}, {}, "num = 0 must be at least 1"),
    ({"dt": float("nan")}, {}, "dt = nan s"),
    ({"joints": True}, {}, "joints = True must be a whole number"),
    ({"dt": "0.005"}, {}, "dt = '0.005': give the step as a number"),
    ({"device": "gpu"}, {}, "device = 'gpu': Warp has none such here; choose from cpu"),
    ({"z_step": "rk4"}, {}, "z_step = 'rk4' is unknown; choose from euler, exact"),
    ({}, {"q": torch.zeros(2, dtype=torch.bool)}, "q is of torch.bool; give real numbers"),
    ({}, {"q": [[0.0], [0.0, 1.0]]}, "q has rows of different lengths; give an array"),
    ({}, {"mask": [[True], [True, False]]}, "mask has rows of different lengths"),
    ({}, {"q": np.zeros((2, 1))}, r"q has shape \(2, 1\), need \(2,\)"),
    ({}, {"q": ["a", "b"]}, "q is of <U1; give real numbers"),
    ({}, {"current": np.zeros(2, complex)}, "current is of complex128; give real numbers"),
    ({}, {"qd": torch.zeros(2, requires_grad=True)}, r"qd requires a gradient, .* pass qd.detach\(\)"),
    ({}, {"qd": wp.zeros(2, dtype=wp.float64, device="cpu")}, "qd is a Warp array of float64; give float32"),
    ({}, {"qd": np.zeros(3)}, r"qd has shape \(3,\), need \(2,\)"),
    ({}, {"mask": [1, 0]}, "mask is of int64; give bool"),
    ({}, {"mask": [True]}, r"mask has shape \(1,\), need \(2,\)"),
    ({}, {"out": np.zeros(3)}, r"out has shape \(3,\), need \(2,\)"),
    ({}, {"out": np.zeros(2, int)}, "out is a ndarray of int64; with this q give a NumPy array of floats"),
    ({}, {"out": torch.zeros(2)}, "out is a Tensor of torch.float32; with this q give a NumPy array"),
]


@pytest.mark.parametrize(("made", "given", "said"), BAD)
def test_a_wrong_argument_is_one_error_that_names_it(made: dict, given: dict, said: str) -> None:
    """And nothing has happened to the joints."""
    arguments = {"num": 2, "dt": DT, **made}
    if made:
        with pytest.raises((TypeError, ValueError), match=said):
            JointBatch(**arguments)
        return
    joints = JointBatch(**arguments)
    before = joints.state()
    with pytest.raises((TypeError, ValueError), match=said):
        if "mask" in given:
            joints.reset(**given)
        joints.step(**{"q": np.zeros(2), "qd": np.ones(2), "current": 1.0, **given})
    for name, value in joints.state().items():
        np.testing.assert_array_equal(value, before[name])


def test_the_state_of_another_batch_is_refused() -> None:
    """Of another number of joints, of another device, or of none; the batch stays as it was."""
    joints = JointBatch(num=2, dt=DT)
    before = joints.state()
    lagging = replace(brake(), effects=(make_effect("command_delay", STRENGTHS["command_delay"]),))
    for other in (JointBatch(num=3, dt=DT).state(), {}):
        with pytest.raises(ValueError, match="it is of another batch"):
            joints.load_state(other)
    with pytest.raises(ValueError, match="it is of another batch"):
        JointBatch(lagging, 2, dt=DT).load_state(before)
    for name, value in joints.state().items():
        np.testing.assert_array_equal(value, before[name])


@pytest.mark.parametrize("effects", [(), ("remanence", "coulomb_friction", "command_delay", "coil_lag")])
def test_the_law_is_even_in_the_current_and_keeps_no_number(effects: tuple[str, ...]) -> None:
    """-I is as I, cut to the largest by size; NaN or infinity in an input of a joint is NaN in its torque and bound."""
    model = replace(brake(), effects=tuple(make_effect(name, STRENGTHS[name]) for name in effects))
    batches = [JointBatch(model, 3, dt=DT) for _ in range(2)]
    q, qd, current = motion(60, (3,), seed=4)
    current = 2.0 * np.abs(current)
    for k in range(60):
        rows = [batch.step(q[k], qd[k], sign * current[k]) for batch, sign in zip(batches, (1.0, -1.0), strict=True)]
        np.testing.assert_array_equal(*rows)
        np.testing.assert_array_equal(*(batch.bound() for batch in batches))
    for wrong in (np.nan, np.inf, -np.inf):
        for k in range(3):
            joints = JointBatch(model, 3, dt=DT)
            plain = JointBatch(model, 3, dt=DT)
            given = [np.full(3, 0.1), np.array([0.0, 0.05, 2.0]), np.full(3, 1.0)]
            wanted = plain.step(*given)
            for joint in (0, 1):  # at rest, where eq. 18 would hold with full torque
                given[k][joint] = wrong
            got = joints.step(*given)
            assert np.isnan(got[:2]).all() and np.isnan(joints.bound()[:2]).all()
            assert got[2] == wanted[2] and joints.bound()[2] == plain.bound()[2]
