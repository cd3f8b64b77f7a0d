"""A model file carries all that is known of a device: every station reads back every number."""

import shutil
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import newton
import numpy as np
import pytest
import warp as wp

from mrwarp.actuator.newton_drive import DriveMR
from mrwarp.cli import main
from mrwarp.effects.catalogue import HYSTERESIS
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.identify.learn import bench_parameters
from mrwarp.identify.parameters import LINEAR, SHAPE
from mrwarp.model_file import (
    JOINT_UNITS,
    Effect,
    FittedOn,
    Model,
    Parameter,
    completed,
    load_model,
    make_effect,
    parameter_unit,
    save_model,
)
from mrwarp.params import HoldParams, MrParams
from mrwarp.usd.asset import device_lines, load_robot, with_model
from mrwarp.usd.open_stage import ASSETS
from tests.models import LOOP, model_of

EFFECTS = (make_effect("coil_lag", {"time_constant": 0.012}), make_effect("torque_bias", {"bias": 0.07}))
UNKNOWN = Effect(name="my_own", parameters={"x": Parameter(value=0.3, unit="V", ci95=(0.2, 0.4))})


def device() -> Model:
    """A device whose every number, even gates, motor and coil, differs from the paper's."""
    values = {name: 0.91 * value if abs(value) > 1e-9 else 0.013 for name, value in MrParams() if name != "q_neutral"}
    values["safety_factor"] = 1.1
    parameters = {
        name: Parameter(value=v, unit=parameter_unit(name, JOINT_UNITS), ci95=(v - 0.1, v + 0.2))
        for name, v in values.items()
    }
    origin = FittedOn(source="bench", trajectories=4, samples=4000, rate=1000.0, current=(0.0, 1.2))
    return Model(parameters=parameters, fitted_on=origin, effects=(*EFFECTS, UNKNOWN), seed=3, versions={"mrwarp": "1"})


def saved(model: Model, folder: Path) -> Path:
    """Its file."""
    return save_model(model, folder / "model.json")


def applied(model: Model, folder: Path) -> Path:
    """The robot's file with the model on all four legs."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", folder / "robot.usda"))
    assert main(["asset", "apply", str(robot), str(saved(model, folder))]) == 0
    return robot


def from_file(model: Model, folder: Path) -> dict[str, float]:
    """Station: a file written and read."""
    assert load_model(saved(model, folder)) == model
    return load_model(saved(model, folder)).to_params().to_dict()


def from_diagnosis(model: Model, folder: Path) -> dict[str, float]:
    """Station: ``diagnose --model``, which fits eqs. 14 and 15 again and keeps the rest."""
    fitted = {name: model.parameters[name] for name in (*LINEAR, *SHAPE, "q_offset", "q_center")}
    refitted = replace(
        model, parameters=fitted, effects=EFFECTS, fitted_on=replace(model.fitted_on, current=(0.3, 1.0))
    )
    assert completed(refitted, model) == model
    return completed(refitted, model).to_params().to_dict()


def from_export(model: Model, folder: Path) -> dict[str, float]:
    """Station: ``asset apply``, then ``asset export``."""
    back = folder / "back.json"
    assert main(["asset", "export", str(applied(model, folder)), "--out", str(back)]) == 0
    assert load_model(back) == model
    return load_model(back).to_params().to_dict()


def from_asset(model: Model, folder: Path) -> dict[str, float]:
    """Station: the robot of an applied file, all four legs."""
    legs = [a for a in load_robot(applied(model, folder)).actuators if a.mr]
    assert all(leg.mr == legs[0].mr and leg.effects == model.effects for leg in legs)
    assert legs[0].measured_current == (0.0, 1.2) and legs[0].holding_measured and not legs[0].is_paper_device
    assert legs[0].mr is not None
    return legs[0].mr.to_dict()


def from_environment(model: Model, folder: Path) -> dict[str, float]:
    """Station: what the robot's kernels read, in 32 bits."""
    env = WalkEnv(replace(TaskCfg(num_envs=1), model=str(saved(model, folder)), randomize=None))
    assert env.actuator.effects is not None
    return {name: float(env.actuator.param(name).numpy()[0, 0]) for name, _ in MrParams()}


def from_drive(model: Model, folder: Path) -> dict[str, float]:
    """Station: the drive in somebody's own scene, in 32 bits; a motor is there only where it is asked for."""
    builder = newton.ModelBuilder()
    link = builder.add_link(mass=1.0, inertia=wp.mat33(np.eye(3)))
    joint = builder.add_joint_revolute(parent=-1, child=link, axis=(0.0, 0.0, 1.0))
    builder.add_articulation([joint])
    motor = {name: model.values[name] for name in ("kp_base", "kd")}
    DriveMR.from_model(saved(model, folder), builder, index=builder.joint_qd_start[joint], **motor)
    (actuator,) = builder.finalize(device="cpu").actuators
    drive = actuator.drive
    assert isinstance(drive, DriveMR)
    return {name: float(drive.param(name).numpy()[0]) for name, _ in MrParams()}


def from_learning(model: Model, folder: Path) -> dict[str, float]:
    """Station: ``learn``, whose networks work with eqs. 14 and 15."""
    return bench_parameters(load_model(saved(model, folder)).values)


@pytest.mark.parametrize(
    "station",
    [from_file, from_diagnosis, from_export, from_asset, from_environment, from_drive, from_learning],
)
def test_every_number_arrives(station: Callable[[Model, Path], dict[str, float]], tmp_path: Path) -> None:
    """None of the device's numbers is the paper's, and each arrives."""
    model = device()
    paper, found = MrParams().to_dict(), station(model, tmp_path)
    names = set(model.values) & set(found)
    least = {"D", "B", "C", "I1", "K0", "K1", "alpha", "beta", "gamma", "q_offset", "q_center"}
    assert names == set(model.values) or (station is from_learning and names >= least)
    for name in names:
        assert found[name] == pytest.approx(model.values[name], rel=1e-6), name
        assert found[name] != pytest.approx(paper[name], rel=1e-3), name


def test_a_model_of_other_units_is_not_completed() -> None:
    """Numbers in other units are not mixed."""
    linear = replace(device(), units={"q": "m", "current": "A", "torque": "N"})
    with pytest.raises(ValueError, match="in m, A, N, the recording in rad, A, N·m; convert one"):
        completed(device(), linear)


def small(**changes: float) -> Model:
    """A brake of 2.5 N·m at 1 A whose holding nobody measured."""
    values = dict(zip(LOOP, (0.0, 0.01, 0.0, 0.0, 0.5, 24.5, 0.1, 15.0, -5.0), strict=True))
    return model_of({**values, **changes}, rate=1000.0, current=(0.0, 1.0))


def test_unmeasured_holding_follows_from_sliding() -> None:
    """The yield torque is that of slow sliding: 2.5 N·m at 1 A, and in proportion within 3 % below."""
    params = small().to_params()
    assert params.coil.current_max == 1.0  # the bench's largest, not the paper's 1.5 A
    assert params.bouc_wen.sliding_torque(1.0) == pytest.approx(2.5)
    current = np.linspace(0.05, 1.0, 20)
    ratio = (current / params.hold.K) ** params.hold.n
    np.testing.assert_allclose(params.hold.T_max * ratio / (1.0 + ratio), 2.5 * current, atol=0.03 * 2.5)
    beyond = small().to_params(extrapolate=True)
    assert beyond.coil.current_max == 1.5
    assert HoldParams.unmeasured(beyond.bouc_wen, 1.5)["T_max"] == beyond.hold.T_max > params.hold.T_max


def test_unmeasured_holding_saturates_as_sliding_does() -> None:
    """K1*tanh(u*I)/u in place of K1*I: 0.5 + 24.5*tanh(2)/2 over 10/rad."""
    saturating = replace(small(), effects=(make_effect("current_saturation", {"u": 2.0}),)).to_params()
    assert saturating.hold.yield_torque(1.0) == pytest.approx(0.05 + 2.45 * np.tanh(2.0) / 2.0)
    assert saturating.hold.yield_torque(0.0) == 0.0


def test_a_device_takes_what_its_bench_gave_it() -> None:
    """3 A where it was measured with 3 A: 1.5 A are the paper's device. A smaller limit that somebody set stands."""
    large = replace(small(), fitted_on=replace(small().fitted_on, current=(0.0, 3.0)))
    for own, extrapolate, most in (
        (1.5, False, 3.0),
        (1.5, True, 3.0),
        (0.8, False, 0.8),
        (5.0, False, 3.0),
        (5.0, True, 5.0),
        (0.0, False, 0.0),
    ):
        params = large.to_params(MrParams().replace(current_max=own), extrapolate=extrapolate)
        assert params.coil.current_max == most, (own, extrapolate)


def test_unmeasured_holding_is_said(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """apply warns; the robot's devices know it and say so; the paper's robot and a measured device do not."""
    robot = applied(small(), tmp_path)
    assert "warning: no break-away test" in capsys.readouterr().out
    asset = load_robot(robot)
    legs = [a for a in asset.actuators if a.mr]
    assert not any(leg.holding_measured or leg.is_paper_device for leg in legs)
    assert legs == [a for a in with_model(load_robot(), small()).actuators if a.mr]
    line, unknown = device_lines(asset.actuators)
    assert "holding.csv" in line and "yields at 2.5 N·m with 1 A" in line
    assert unknown.startswith("note: not known of FL_calf, FR_calf, RL_calf, RR_calf: coil resistance, mass; what")
    paper = load_robot().actuators
    assert all(a.is_paper_device and a.holding_measured for a in paper if a.mr) and list(device_lines(paper)) == []
    assert list(device_lines(with_model(load_robot(), small(T_max=3.0)).actuators)) == [unknown]


def test_a_holding_torque_set_by_hand_is_known(tmp_path: Path) -> None:
    """A number that the user wrote over the rule's counts, without a warning."""
    robot = applied(small(), tmp_path)
    assert main(["asset", "set", str(robot), "MRDevice", "T_max", "4"]) == 0
    legs = [a for a in load_robot(robot).actuators if a.mr]
    assert all(leg.holding_measured and leg.mr and leg.mr.hold.T_max == 4.0 for leg in legs)


def test_currents_end_where_they_were_measured(tmp_path: Path) -> None:
    """``asset apply`` limits the coil to the bench's range; with --extrapolate it does not, and that is said."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", tmp_path / "robot.usda"))
    path = str(saved(small(T_max=3.0), tmp_path))
    for words, most in (([], 1.0), (["--extrapolate"], 1.5)):
        out = tmp_path / f"{most}.usda"
        assert main(["asset", "apply", str(robot), path, "--out", str(out), *words]) == 0
        legs = [a for a in load_robot(out).actuators if a.mr]
        assert all(leg.mr and leg.mr.coil.current_max == most for leg in legs)
        *lines, unknown = device_lines(legs)
        assert "not known of" in unknown
        assert lines == ([] if most == 1.0 else [lines[0]])
        assert most == 1.0 or "measured up to 1 A; more is a guess" in lines[0]


def test_devices_that_are_identical_are_reported_once(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``asset apply`` prints a number once for the class and its four legs; a leg of its own numbers separately."""
    robot = applied(small(), tmp_path)
    out = capsys.readouterr().out
    assert out.count("newton:mr:K1:") == 1 and out.count("the same on /mr_go/actuators/FL_calf, ") == 1
    assert main(["asset", "set", str(robot), "FL_calf", "K1", "9"]) == 0
    capsys.readouterr()
    assert main(["asset", "set", str(robot), "MRDevice", "K1", "8"]) == 0
    out = capsys.readouterr().out
    assert "K1: 24.5 -> 8 N" in out and "FL_calf keeps its own newton:mr:K1 = 9 N" in out


def test_a_law_in_place_of_another_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Kwok's law, then Dahl's: the second says which was there before."""
    kwok = make_effect("kwok", {"slope": 0.7, "width": 0.2})
    plain = small(alpha=0.0, beta=1.0, gamma=0.0)
    robot = applied(replace(plain, effects=(kwok,)), tmp_path)
    dahl = make_effect("dahl", {p.name: 0.5 for p in HYSTERESIS["dahl"].parameters})
    capsys.readouterr()
    assert main(["asset", "apply", str(robot), str(saved(replace(plain, effects=(dahl,)), tmp_path))]) == 0
    assert "newton:mr:law: kwok -> dahl" in capsys.readouterr().out
