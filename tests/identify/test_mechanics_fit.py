"""A motor or an arm's joint without a device: inertia, gravity, spring and friction from one fit."""

from pathlib import Path

import numpy as np
import pytest

from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.identify.fit_report import lines, to_model
from mrwarp.identify.mechanics_fit import fit_joint
from mrwarp.model_file import load_model, make_effect, of_bench, save_model
from mrwarp.recording.load import Recording, Trajectory, load_recording

CASES = Path(__file__).parents[3] / "shared" / "cases"


def arm(
    inertia: float, weight: float, down: float, spring: float, viscous: float, dry: float, current: str = "none"
) -> Recording:
    """An arm that a controller drives through sines, by Runge and Kutta at 2 kHz; logged at 250 Hz with noise."""
    rng, runs, dt = np.random.default_rng(5), 6, 5e-4
    w, a = 2.0 * np.pi * rng.uniform(0.4, 2.0, (2, runs)), rng.uniform(0.3, 0.7, (2, runs))

    def drive(t: float, x: np.ndarray) -> np.ndarray:
        goal, speed = (a * np.sin(w * t)).sum(axis=0), (a * w * np.cos(w * t)).sum(axis=0)
        return 400.0 * inertia * (goal - x[0]) + 30.0 * inertia * (speed - x[1])

    def rates(t: float, x: np.ndarray) -> np.ndarray:
        load = weight * np.sin(x[0] - down) + spring * x[0] + viscous * x[1] + dry * np.tanh(x[1] / 0.02)
        return np.stack([x[1], (drive(t, x) - load) / inertia])

    x, states, torques = np.zeros((2, runs)), [], []
    for k in range(6000):
        t = k * dt
        if k % 8 == 0:
            states.append(x)
            torques.append(drive(t, x))
        one = rates(t, x)
        two = rates(t + 0.5 * dt, x + 0.5 * dt * one)
        three = rates(t + 0.5 * dt, x + 0.5 * dt * two)
        x = x + dt / 6.0 * (one + 2.0 * two + 2.0 * three + rates(t + dt, x + dt * three))
    (q, qd), tau = np.stack(states, axis=1), np.stack(torques)
    tau = tau + 0.01 * tau.std(axis=0) * rng.normal(size=tau.shape)
    qd, q, t = qd + 0.005 * rng.normal(size=qd.shape), np.round(q, 4), np.arange(len(q)) * 0.004
    found = [Trajectory(id=f"{k}", t=t, q=q[:, k], qd=qd[:, k], current=0.0 * t, torque=tau[:, k]) for k in range(runs)]
    return Recording(trajectories=tuple(found), units={"q": "rad", "current": current, "torque": "N·m"})


def test_an_arm_gives_its_inertia_and_weight_with_its_direction() -> None:
    """Each within 2 % and its interval; what is not there is left out; the model file holds and applies it."""
    found = fit_joint(arm(0.05, 2.0, 0.4, 0.0, 0.04, 0.15))
    effects = {e.name: e for e in found.effects}
    assert "gravity" in effects and effects["rotor_inertia"].values["inertia"] == pytest.approx(0.05, rel=0.02)
    for name, want in (("sine", 2.0 * np.cos(0.4)), ("cosine", -2.0 * np.sin(0.4))):
        number = effects["gravity"].parameters[name]
        assert number.ci95 and number.ci95[0] <= want <= number.ci95[1]
        assert number.value == pytest.approx(want, abs=0.04)
    assert found.estimates["C"].value == 0.0 and found.estimates["C"].ci95 is None
    assert found.held_out is not None and found.held_out < 0.05 and "left out in turn" in "\n".join(lines(found))


def test_a_mass_on_a_spring_has_no_weight() -> None:
    """A spring is C of eq. 14; gravity, which would stand for it, is taken out."""
    found = fit_joint(arm(0.1, 0.0, 0.0, 3.0, 0.05, 0.2))
    assert "gravity" not in {e.name for e in found.effects}
    assert found.estimates["C"].value == pytest.approx(3.0, rel=0.02)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("case", "inertia", "weight"),
    [("pendulum", 0.147, 2.98), ("mass_on_spring", 0.1, None), ("kr300_axis1", 5.8, None)],
)
def test_recorded_joints(case: str, inertia: float, weight: float | None) -> None:
    """The recordings of a pendulum, a mass on a spring and a robot's axis."""
    if not (CASES / case).is_dir():
        pytest.skip("needs the recordings next to the repository")
    effects = {e.name: e for e in fit_joint(load_recording(CASES / case)).effects}
    low, high = effects["rotor_inertia"].parameters["inertia"].ci95 or (np.nan, np.nan)
    assert low <= inertia <= high and ("gravity" in effects) == (weight is not None)
    if weight is not None:
        assert effects["gravity"].values["sine"] == pytest.approx(weight, rel=0.005)


def test_what_belongs_to_the_bench_stays_there(tmp_path: Path) -> None:
    """A marked effect is stored, read again, and absent from the simulator's joint; unmarked it is there."""
    model = to_model(fit_joint(arm(0.05, 2.0, 0.4, 0.0, 0.04, 0.15, "A")))
    save_model(of_bench(model, ("inertia", "gravity")), tmp_path / "model.json")
    again = load_model(tmp_path / "model.json")
    assert {e.name for e in again.effects if e.bench} == {"rotor_inertia", "gravity"}
    joints = [JointBatch(x, num=1, dt=0.005) for x in (model, again, of_bench(again, ()))]
    torques = [float(j.step([0.5], [1.0], [0.0])[0]) for j in joints]
    assert torques[0] == torques[2] and abs(torques[0] - torques[1]) > 0.1
    assert joints[1].inertia == 0.0 and joints[0].inertia == joints[2].inertia > 0.0
    with pytest.raises(ValueError, match="no effect"):
        make_effect("weight", {})
