"""A model that one command writes is taken by every other: stiff, soft, strong, weak and slow devices."""

from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest

from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.cli import check_models, main
from mrwarp.diagnose.pipeline import diagnose
from mrwarp.identify.fit import fit
from mrwarp.identify.fit_report import to_model
from mrwarp.model_file import Model, load_model, save_model
from mrwarp.options.command_line import MODELS, option_types
from mrwarp.options.command_table import COMMANDS, Command, Group
from mrwarp.params import BoucWenParams, MrParams, ParameterError
from mrwarp.recording.load import Recording, Trajectory
from mrwarp.usd.asset import load_robot, with_model
from mrwarp.usd.open_stage import ASSETS
from tests.models import LOOP, model_of

DT = 0.005
REVERSALS = 1.4
"""Of the first run, in a second."""
ONE_SAMPLE = float(np.sqrt(4.0 / 3.0 * REVERSALS * DT))
"""Error, over the torque's size, where a loop that is steeper than a step turns within one sample of each reversal: by
twice the torque, and at a time that is uniform in that sample."""
KINDS = {
    # sliding torque without and per unit of current, rate of the loop [1/rad], viscosity, stiffness, middle and size of
    # the angle [rad], largest current [A]
    "stiff": (0.15, 5.0, 2e4, 0.01, 0.0, 0.0, 0.4, 0.8),
    "soft": (0.15, 5.0, 0.4, 0.01, 0.0, 0.0, 0.4, 0.8),
    "strong": (20.0, 130.0, 25.0, 140.0, 150.0, 0.0, 0.4, 2.0),
    "weak": (2e-4, 0.1, 25.0, 1e-5, 0.0, 0.0, 0.4, 0.02),
    "one that turns slowly, far from zero": (0.15, 5.0, 4e3, 40.0, 0.0, 200.0, 2e-3, 0.8),
}


def recorded(kind: str, count: int = 4) -> Recording:
    """Runs of 2 s of eq. 15 with gamma = 0 in closed form, noise of 0.2 % of the torque."""
    rng = np.random.default_rng(5)
    rest, gain, rate, viscosity, stiffness, middle, size, top = KINDS[kind]
    t, runs = np.arange(400) * DT, []
    for k in range(count):
        w = 2.0 * np.pi * (0.7 + 0.3 * (k % 4))
        q, qd = size * np.sin(w * t + k), size * w * np.cos(w * t + k)
        current = np.full(400, top * (k % 4) / 3) if k % 4 else top * ((t / 0.3).astype(int) % 3) / 2.0
        u, loop = 0.0, np.empty(400)
        for i, step in enumerate(np.diff(q, prepend=q[0])):
            u += (np.sign(step) - u) * -np.expm1(-rate * abs(step))
            loop[i] = (rest + gain * current[i]) * u
        torque = loop + viscosity * qd + stiffness * q
        torque += 2e-3 * torque.std() * rng.normal(size=400)
        runs.append(Trajectory(id=f"run{k}", t=t, q=q + middle, qd=qd, current=current, torque=torque))
    return Recording(trajectories=tuple(runs))


def simulated(model: Model, recording: Recording) -> float:
    """Error of the simulator's joint along the first run, over the torque's standard deviation."""
    run, joint = recording.trajectories[0], JointBatch(model, dt=DT)
    qd = np.diff(run.q, append=run.q[-1]) / DT  # of the step that begins
    torque = np.array([joint.step(*map(np.atleast_1d, x))[0] for x in zip(run.q, qd, run.current, strict=True)])
    # the step's torque belongs to its end, and to the current of its beginning
    settled = np.diff(run.current)[20:] == 0.0
    return float((torque[20:-1] - run.torque[21:])[settled].std() / run.torque.std())


@pytest.mark.parametrize("kind", KINDS)
def test_what_fit_writes_is_simulated(kind: str, tmp_path: Path) -> None:
    """The file is read, the robot takes it, and the joint bears what was measured."""
    recording = recorded(kind)
    file = save_model(to_model(fit(recording)), tmp_path / "model.json")
    params = load_model(file).to_params()
    assert all(a.mr for a in with_model(load_robot(), load_model(file)).actuators if a.joint.endswith("calf"))
    rest, gain, *_, top = KINDS[kind]
    if kind != "soft":  # whose loop never slides on a way of 0.8 rad
        bias = 2.0 * REVERSALS * DT  # as much of the time the torque may have the other sign
        assert params.bouc_wen.sliding_torque(top) == pytest.approx(rest + gain * top, rel=bias)
    assert simulated(load_model(file), recording) < ONE_SAMPLE


@pytest.mark.slow
def test_what_diagnose_writes_is_simulated(tmp_path: Path) -> None:
    """Dry friction behind a spring, whose loop is over within an encoder's step: by a law that turns slower."""
    recording = recorded("stiff", 6)
    rest, gain, *_, top = KINDS["stiff"]
    found = diagnose(recording, effects=("series_compliance",)).model
    assert found is not None
    model = load_model(save_model(found, tmp_path / "model.json"))
    bias = 2.0 * REVERSALS * DT  # as above
    assert model.to_params().bouc_wen.sliding_torque(top) == pytest.approx(rest + gain * top, rel=bias)
    assert simulated(model, recording) < 1.2 * ONE_SAMPLE


def dry() -> Model:
    """A brake whose loop is as steep as a diagnosis may find it on a joint that moves by milliradians."""
    values = dict(zip(LOOP, (0.0, 0.01, 0.0, 0.0, 9e6, 2.4e8, 1e4, 6e7, -1e6), strict=True))
    return model_of(values, rate=500.0, current=(0.0, 0.8))


def with_models(entries: Command | Group, words: tuple[str, ...] = ()) -> Iterator[tuple[tuple[str, ...], type]]:
    """Commands that take a model file."""
    if isinstance(entries, Group):
        for name, entry in entries.commands.items():
            yield from with_models(entry, (*words, name))
        return
    options = entries.load()
    if option_types(options).keys() & {*MODELS}:
        yield words, options


@pytest.mark.parametrize(
    ("words", "options"),
    list(with_models(Group("", COMMANDS))),
    ids=lambda x: " ".join(x) if isinstance(x, tuple) else "",
)
def test_every_command_takes_a_stiff_device(words: tuple[str, ...], options: type, tmp_path: Path) -> None:
    """The reader of the option reads the file."""
    file = save_model(dry(), tmp_path / "model.json")
    check_models({name: file for name in option_types(options) if name in MODELS})


def test_a_stiff_device_goes_onto_a_robot(tmp_path: Path) -> None:
    """``asset apply`` and ``robot fit-device`` take it, and the files that they write are read."""
    file, robot = save_model(dry(), tmp_path / "model.json"), ASSETS / "mr_go.usda"
    applied, fitted = tmp_path / "applied.usda", tmp_path / "fitted.usda"
    assert main(["asset", "apply", str(robot), str(file), "--out", str(applied)]) == 0
    knees = ["--joint", "*_calf", "--model", str(file)]
    assert main(["robot", "fit-device", str(robot), *knees, "--out", str(fitted)]) == 0
    for out in (applied, fitted):
        legs = [a.mr for a in load_robot(out).actuators if a.mr]
        assert [leg.bouc_wen.beta for leg in legs] == 4 * [6e7]


@pytest.mark.parametrize(("name", "unit"), [("K0", "N·m"), ("K1", "N·m/A")])
def test_the_sliding_torque_is_bounded(name: str, unit: str) -> None:
    """K0 and K1 alone say nothing: 1e9 N·m/rad over a rate of 1e6/rad are 1 kN·m, over one of 10/rad no device's."""
    values = {"beta": 1e6, "gamma": 0.0, name: 1e9}
    assert BoucWenParams(**values).sliding_torque(1.0) < 1e4
    with pytest.raises(
        ParameterError, match=rf"{name}/\(beta \+ gamma\) = 1e\+08 {unit}, .*up to 1e\+06 {unit}; lower"
    ):
        MrParams().replace(**{**values, "beta": 10.0})
