"""Faults of a recording: found where they were put in, silent where effects or noise make runs differ."""

import os
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks.confusion.case import make_case
from benchmarks.confusion.families import Plan
from mrwarp.diagnose.checks.recording_faults import recording_faults, turned_signs
from mrwarp.recording.differentiate import differentiate, quiet_half
from mrwarp.recording.load import Recording, Trajectory, load_recording

DATA = Path(os.environ.get("MRWARP_DATA", Path(__file__).parents[4] / "shared" / "data"))
pytestmark = pytest.mark.usefixtures("few_trees")
FAULTY = (1, 4, 5)


def changed(recording: Recording, offset: float = 0.0, factor: float = 1.0) -> Recording:
    """The recording with another torque in some runs."""
    runs = list(recording.trajectories)
    for k in FAULTY:
        runs[k] = replace(runs[k], torque=factor * runs[k].torque + offset)
    return replace(recording, trajectories=tuple(runs))


@pytest.fixture(scope="module")
def healthy() -> Recording:
    """A bench recording of a device with one hidden effect."""
    return make_case("coulomb_friction", level=0.8, seed=5, size="small").recording


@pytest.mark.parametrize("effect", ["wear", "temperature_drift", "cogging", "current_saturation"])
def test_silent_without_a_fault(effect: str) -> None:
    """Effects and the noise of a stand are no fault of the recording, which stays as it is."""
    recording = make_case(effect, level=0.8, seed=6, size="small").recording
    same, faults = recording_faults(recording)
    assert same is recording and not faults


def test_a_moved_zero_is_told_and_taken_out(healthy: Recording) -> None:
    """Which runs, and by how much; what is left is the recording as it was, but for one zero of all runs."""
    std = float(np.concatenate([r.torque for r in healthy.trajectories]).std())
    mended, [fault] = recording_faults(changed(healthy, offset=0.3 * std))
    assert fault.kind == "torque_zero" and fault.unit == "N·m"
    assert fault.trajectories == tuple(healthy.trajectories[k].id for k in FAULTY)
    assert fault.value == pytest.approx(0.3 * std, rel=0.1) and fault.ci95[0] <= fault.value <= fault.ci95[1]
    left = [a.torque - b.torque for a, b in zip(mended.trajectories, healthy.trajectories, strict=True)]
    assert max(float(np.ptp(x)) for x in left) < 1e-9 and np.ptp([x[0] for x in left]) < 0.06 * std
    assert "the zero of the torque moved between runs" in fault.sentence and "3 of 12 runs" in fault.sentence


def test_another_sign(healthy: Recording) -> None:
    """Runs with the other sign are turned."""
    mended, [fault] = recording_faults(changed(healthy, factor=-1.0))
    assert fault.kind == "torque_sign" and fault.value == pytest.approx(-1.0, rel=0.1)
    assert fault.trajectories == tuple(healthy.trajectories[k].id for k in FAULTY)
    k = FAULTY[0]
    turned = -1.0 / fault.per_trajectory[fault.trajectories[0]] * healthy.trajectories[k].torque
    np.testing.assert_allclose(mended.trajectories[k].torque, turned, rtol=1e-9)


def test_another_device_is_reported_and_left_out(healthy: Recording) -> None:
    """Runs of a device with less stress and more friction are named; what is left is the other device alone."""
    mixed, runs = list(healthy.trajectories), FAULTY
    std = float(np.concatenate([r.torque for r in mixed]).std())
    for k in runs:
        rubs = 0.4 * np.tanh(mixed[k].qd / 0.1) + 0.1 * mixed[k].qd / np.abs(mixed[k].qd).max()
        mixed[k] = replace(mixed[k], torque=0.5 * mixed[k].torque + std * rubs)
    rest, [fault] = recording_faults(replace(healthy, trajectories=tuple(mixed)))
    assert fault.kind == "other_device" and fault.unit == "1" and fault.value > 1.5
    assert fault.trajectories == tuple(healthy.trajectories[k].id for k in runs)
    assert [r.id for r in rest.trajectories] == [r.id for k, r in enumerate(healthy.trajectories) if k not in runs]
    assert f"{len(runs)} of 12 runs" in fault.sentence and "in a folder of their own" in fault.sentence


@pytest.mark.parametrize("condition", ["current", "speed"])
def test_runs_that_a_condition_tells_apart_are_no_other_device(healthy: Recording, condition: str) -> None:
    """Where other runs have another control input or speed too, that may be what changes the torque."""
    moved = list(healthy.trajectories)
    for k in FAULTY:
        run = moved[k]
        torque = 0.5 * run.torque + 0.5 * run.torque.std() * np.tanh(run.qd / 0.1)
        if condition == "current":
            moved[k] = replace(run, current=np.full_like(run.current, 5.0), torque=torque)
        else:
            moved[k] = replace(run, q=10.0 * run.q, qd=10.0 * run.qd, torque=torque)
    _, faults = recording_faults(replace(healthy, trajectories=tuple(moved)))
    assert "other_device" not in [fault.kind for fault in faults]


def test_short_strokes_of_an_elastic_contact_are_no_other_device() -> None:
    """Strokes within and beyond the slip of elements in parallel, slow and quick, of an angle with noise."""
    rng, t, limits, runs = np.random.default_rng(2), np.arange(3000) / 1000.0, np.linspace(8e-6, 4e-5, 8), []
    for k in range(12):
        q = 0.5e-3 * (0.2, 0.12, 0.06)[k % 3] * np.sin(2.0 * np.pi * (0.5, 1.0, 2.0, 5.0)[k // 3] * t + k)
        bent, force = np.zeros(8), np.zeros(len(t))
        for i, dq in enumerate(np.diff(q)):
            bent = np.clip(bent + dq, -limits, limits)
            force[i + 1] = 1e5 * bent.mean()
        q = q + 2e-7 * rng.normal(size=len(t))
        qd = differentiate(q, 1e-3, quiet_half(q, 1e-3))
        runs.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, qd_derived=True, current=0.0 * t, torque=force))
    assert recording_faults(Recording(trajectories=tuple(runs)))[1] == ()


def test_spikes_hide_no_moved_zero(healthy: Recording) -> None:
    """Single samples far off, five in each run, of the torque's own size and more."""
    std = float(np.concatenate([r.torque for r in healthy.trajectories]).std())
    rng, runs = np.random.default_rng(3), []
    for run in changed(healthy, offset=0.3 * std).trajectories:
        torque = run.torque.copy()
        torque[rng.integers(0, len(torque), 5)] += rng.choice([-1.0, 1.0], 5) * rng.uniform(5.0, 20.0, 5) * std
        runs.append(replace(run, torque=torque))
    _, [fault] = recording_faults(replace(healthy, trajectories=tuple(runs)))
    assert fault.kind == "torque_zero" and fault.value == pytest.approx(0.3 * std, rel=0.15)


def test_few_runs_carry_no_verdict(healthy: Recording) -> None:
    """Three runs say nothing about the rest."""
    few = replace(healthy, trajectories=healthy.trajectories[:3])
    assert recording_faults(few) == (few, ())


def test_the_damper_whose_zero_moved() -> None:
    """Public recordings: the mean force is 103 to 137 N in 34 runs, -12 to 5 N in 13; the groups differ by 130 N."""
    folder = DATA / "mr_utfpr"
    if not folder.is_dir():
        pytest.skip(f"{folder} is not here; docs/data.md says where the recordings come from")
    _, [fault] = recording_faults(load_recording(folder))
    assert fault.kind == "torque_zero" and fault.unit == "N"
    assert len(fault.trajectories) == 34 and fault.value == pytest.approx(130.0, rel=0.1)


@pytest.mark.parametrize(
    ("seed", "index", "size", "kinds"),
    [
        (77, 19, "large", ()),
        (1501, 17, "small", ("none",)),
        *(
            pytest.param(*drawn, marks=pytest.mark.slow)
            for drawn in ((78, 9, "small", ()), (1007, 9, "small", ()), (1501, 57, "small", ("none",)))
        ),
    ],
)
def test_a_law_of_another_shape_is_no_fault(seed: int, index: int, size: str, kinds: tuple[str, ...]) -> None:
    """Kwok's and Spencer's law: their runs gather in groups by what describes them, or one stands out by one look."""
    recording = Plan(family="foreign", level=0.1, seed=seed, size=size, kinds=kinds).make(index).recording
    assert recording_faults(recording) == (recording, ())


@pytest.mark.parametrize(("family", "seed", "index"), [("none", 2, 0), ("foreign", 77, 1)])
def test_a_gain_of_one_run_is_told(family: str, seed: int, index: int) -> None:
    """Twice the torque in one run, on the paper's device and on one by Kwok's law; it is divided by its factor."""
    runs = list(Plan(family=family, level=0.1, seed=seed, size="small").make(index).recording.trajectories)
    runs[5] = replace(runs[5], torque=2.0 * runs[5].torque)
    mended, [fault] = recording_faults(Recording(trajectories=tuple(runs)))
    assert fault.kind == "torque_gain" and fault.trajectories == (runs[5].id,)
    assert fault.value == pytest.approx(2.0, rel=0.3)
    divided = runs[5].torque / fault.per_trajectory[runs[5].id]
    np.testing.assert_allclose(mended.trajectories[5].torque, divided, rtol=1e-9)


def mixed_devices(other: tuple[int, ...], load: float, viscous: float, seed: int = 3) -> Recording:
    """Ten runs of a device of bristles that slip at 0.5 + 1.2*I; those of ``other`` are of another device."""
    rng = np.random.default_rng(seed)
    t = np.arange(1200) / 200.0
    runs = []
    for k in range(10):
        size, f, phase = (rng.uniform(low, high, (3, 1)) for low, high in ((0.1, 0.4), (0.3, 1.5), (0.0, 6.0)))
        q = (size * np.sin(2.0 * np.pi * f * t + phase)).sum(axis=0)
        qd = np.gradient(q, t)
        bent = np.zeros(len(t))
        for i, dq in enumerate(np.diff(q)):
            bent[i + 1] = np.clip(bent[i] + dq, -0.02, 0.02)
        current = np.full(len(t), (0.0, 0.5, 1.0)[k % 3])
        dry, slope = (1.1 + load * current, viscous) if k in other else (0.5 + 1.2 * current, 0.08)
        torque = dry * bent / 0.02 + slope * qd + 0.01 * rng.standard_normal(len(t))
        runs.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, current=current, torque=torque))
    return Recording(trajectories=tuple(runs))


def test_two_devices_in_one_folder() -> None:
    """The runs of the second device, half of all, are named and left out."""
    other = (5, 6, 7, 8, 9)
    mended, [fault] = recording_faults(mixed_devices(other, load=0.5, viscous=0.25))
    assert fault.kind == "other_device" and fault.trajectories == tuple(f"run{k}" for k in other)
    assert [r.id for r in mended.trajectories] == [f"run{k}" for k in range(10) if k not in other]
    assert "another device" in fault.sentence and fault.value > 1.5


def test_a_device_like_the_first_but_stronger_is_a_gain() -> None:
    """Half of the runs are 1.7 times as strong in every respect: that is a gain, named for all of them."""
    other = (5, 6, 7, 8, 9)
    recording = mixed_devices((), load=0.0, viscous=0.0)
    runs = [replace(r, torque=1.7 * r.torque) if k in other else r for k, r in enumerate(recording.trajectories)]
    _, [fault] = recording_faults(replace(recording, trajectories=tuple(runs)))
    assert fault.kind == "torque_gain" and fault.trajectories == tuple(f"run{k}" for k in other)
    assert fault.value == pytest.approx(1.7, rel=0.1)


def test_a_small_slow_run_of_a_curved_law_is_no_gain() -> None:
    """An absorber of gas and oil: over a slow, small sine its curved force has another factor."""
    t = np.arange(3000) / 500.0
    runs = []
    for k in range(12):
        size, f = (0.02, 0.035, 0.05)[k % 3], (0.5, 1.0, 1.7, 2.5)[k // 3]
        q = size * np.sin(2.0 * np.pi * f * t + 0.5 * k)
        v = 2.0 * np.pi * f * size * np.cos(2.0 * np.pi * f * t + 0.5 * k)
        out = 1500.0 * v / (1.0 + 2.0 * np.abs(v)) + 300.0 * np.tanh(v / 0.08)
        force = np.where(v > 0.0, out, 700.0 * v + 250.0 * v * np.abs(v) + 90.0 * np.tanh(v / 0.05))
        force = force + 180.0 / (1.0 - q / 0.25) ** 1.2
        runs.append(Trajectory(id=f"run{k}", t=t, q=q, qd=v, current=np.zeros(len(t)), torque=force))
    assert recording_faults(Recording(trajectories=tuple(runs)))[1] == ()


def test_the_run_that_drives_is_turned_and_not_the_one_that_resists() -> None:
    """Two runs at the largest current, one of them turned: most runs say little of which, eq. 14 does."""
    runs = []
    for k in range(6):
        rng, t = np.random.default_rng([7, k]), np.arange(900) * 0.005
        q, qd = np.zeros((2, 900))
        for _ in range(3):
            w, phase, a = 2.0 * np.pi * rng.uniform(0.3, 1.5), rng.uniform(0.0, 6.0), rng.uniform(0.1, 0.4)
            q, qd = q + a * np.sin(w * t + phase), qd + a * w * np.cos(w * t + phase)
        current = np.full(900, (0.0, 0.5, 1.0)[k % 3])
        torque = (0.1 + 0.8 * current) * np.tanh(qd / 0.1) + 0.2 * q + 0.02 * rng.normal(size=900)
        runs.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, current=current, torque=torque))
    for k in (2, 5):
        turned = [replace(run, torque=-run.torque) if i == k else run for i, run in enumerate(runs)]
        mended, fault = turned_signs(Recording(trajectories=tuple(turned)))
        assert fault is not None and fault.trajectories == (f"run{k}",)
        assert all((a.torque == b.torque).all() for a, b in zip(mended.trajectories, runs, strict=True))
    assert turned_signs(Recording(trajectories=tuple(runs)))[1] is None


@pytest.mark.parametrize("turned", [False, True])
def test_a_load_of_the_other_sign_is_no_turned_sensor(turned: bool) -> None:
    """Of a weight and a spring the place decides the sign; what a run takes from the motion says which is a fault."""
    runs = []
    for k in range(5):
        rng, t = np.random.default_rng([8, k]), np.arange(1000) * 0.005
        w, a = 2.0 * np.pi * rng.uniform(0.4, 1.2), rng.uniform(0.3, 0.5)
        q, qd = a * np.sin(w * t), a * w * np.cos(w * t)
        friction, load = 0.1 * np.tanh(qd / 0.05), 1.6 * q + 0.01 * rng.normal(size=1000)
        torque = (-friction if turned else friction) - load if k == 3 else friction + load
        runs.append(Trajectory(id=f"run{k}", t=t, q=q, qd=qd, current=np.zeros(1000), torque=torque))
    fault = turned_signs(Recording(trajectories=tuple(runs)))[1]
    assert (fault.trajectories if fault else None) == (("run3",) if turned else None)
