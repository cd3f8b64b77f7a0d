"""Logs of the virtual robot: what they hold, what was hidden, refusals."""

import json
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.env.natural_units import Scales
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.virtual.described_robot import describe
from mrwarp.robot_logs.virtual.hidden_effects import EFFECTS, Places, parse_all, parse_hidden
from mrwarp.robot_logs.virtual.log_sensors import CLOCK, JITTER, STAMP, Clean, sense
from mrwarp.robot_logs.virtual.motions import Walk, make_motion
from mrwarp.robot_logs.virtual.record_log import LogCfg, record
from tests.robot_logs.arm_log import ARM, JOINTS

PLACES = Places(
    joint=("FL_hip", "FL_calf", "RL_calf"),
    device=("FL_calf", "RL_calf"),
    body=("FL_shank",),
    trunk="base",
    legs={"FL": ("FL_hip", "FL_calf"), "RL": ("RL_calf",)},
)


def test_hidden_effects_are_read_with_place_and_size() -> None:
    """A leg stands for its joints, a size for the first number of several."""
    assert [(h.where, h.values) for h in parse_hidden("coulomb_friction=FL:0.6", PLACES)] == [
        ("FL_hip", (0.6,)),
        ("FL_calf", (0.6,)),
    ]
    assert [h.where for h in parse_hidden("coil_dead=RL", PLACES)] == ["RL_calf"]
    assert [h.where for h in parse_hidden("encoder_offset=*_calf:0.02", PLACES)] == ["FL_calf", "RL_calf"]
    (com,) = parse_hidden("trunk_com=-0.03", PLACES)
    assert (com.where, com.values) == ("base", (-0.03, 0.0, 0.0))


@pytest.mark.parametrize(
    ("texts", "said"),
    [
        ("coil_daed=RL", "there is no effect 'coil_daed'"),
        ("coulomb_friction=0.6", "where? write coulomb_friction=PLACE:SIZE; places: FL_hip"),
        ("coulomb_friction=XX:0.6", "there is no place 'XX' for it; places: FL_hip, FL_calf, RL_calf"),
        ("trunk_mass=heavy", "write trunk_mass=SIZE"),
        ("trunk_mass=90", "90 kg; allowed: -5 to 20 kg"),
        ("coil_dead=RL:3", "it has no size; write coil_dead=PLACE"),
        ("kp=FL:0.9 kp=FL_hip:0.8", "FL_hip is named twice"),
    ],
)
def test_what_cannot_be_hidden_is_refused(texts: str, said: str) -> None:
    """In one line with the remedy."""
    with pytest.raises(ValueError, match="--hide") as refused:
        parse_all(texts.split(), PLACES)
    assert said in str(refused.value)


@pytest.fixture(scope="module")
def air(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Three seconds of MR_Go in the air with friction, an offset and a delay."""
    out = tmp_path_factory.mktemp("air")
    hide = ("coulomb_friction=FR_calf:1.5", "encoder_offset=RL_hip:0.2", "motor_strength=RR_thigh:0.5")
    record(LogCfg(motions=(("chirp", 3.0),), hide=hide, seed=1), out)
    return out


def test_a_log_has_the_contract_s_form(air: Path) -> None:
    """Columns of joints without a base, rising stamps about every 5 ms, gains in log.json.

    Steps of stamps differ by the clock's rate and resolution, their median by four standard errors of the jitter's.
    """
    log = load_log(air)
    (run,) = log.runs
    assert log.base == "fixed" and log.tau_is == "estimate" and not run.base
    assert {"q", "qd", "q_des", "tau", "current", "current_cmd", "temperature"} <= set(run.joint)
    off = 0.005 * CLOCK + STAMP + 4.0 * np.sqrt(np.pi / len(run.t)) * JITTER
    assert np.all(np.diff(run.t) > 0.0) and run.dt == pytest.approx(0.005, abs=off)
    assert log.kp.min() > 0.0 and len(log.joints) == 12
    header = json.loads((air / "log.json").read_text())
    assert "hidden" not in json.dumps(header) and "friction" not in json.dumps(header)


def test_the_truth_stands_beside_the_log(air: Path) -> None:
    """Causes with place and size."""
    hidden = json.loads((air / "truth.json").read_text())["hidden"]
    assert [(h["cause"], h["where"], h["values"]["size"]) for h in hidden] == [
        ("coulomb_friction", "FR_calf", 1.5),
        ("encoder_offset", "RL_hip", 0.2),
        ("motor_strength", "RR_thigh", 0.5),
    ]


def test_hidden_effects_act(air: Path) -> None:
    """A joint with friction rests more often than its mirror image; a weak motor gives half of its command.

    Which is that of the row before, at the state that was read; to four standard errors of the lines through both.
    """
    log = load_log(air)
    (run,) = log.runs
    at = {name: k for k, name in enumerate(log.joints)}
    still = np.abs(run.joint["qd"]) < 0.02
    assert still[:, at["FR_calf"]].mean() > 2.0 * still[:, at["FL_calf"]].mean()
    asked = log.kp * (run.joint["q_des"][:-1] - run.joint["q"][1:]) - log.kd * run.joint["qd"][1:]
    lines = [np.polyfit(asked[:, at[j]], run.joint["tau"][1:, at[j]], 1, cov=True) for j in ("RL_thigh", "RR_thigh")]
    (whole, half), errors = [line[0][0] for line in lines], [np.sqrt(line[1][0, 0]) / line[0][0] for line in lines]
    assert half / whole == pytest.approx(0.5, rel=4.0 * np.hypot(*errors))


def test_a_dead_coil_draws_no_current_while_it_walks(tmp_path: Path) -> None:
    """The others do; the robot moves forward, its feet carry its weight, to a tenth over a few strides."""
    cfg = LogCfg(motions=(("walk", 3.0),), hide=("coil_dead=RL",), policy=DEFAULT_POLICY, motion_capture=True)
    record(cfg, tmp_path)
    (run,) = load_log(tmp_path).runs
    current = np.nan_to_num(run.joint["current"])
    top = {name: current[:, k].max() for k, name in enumerate(load_log(tmp_path).joints)}
    assert top["RL_calf"] < 0.05 and min(top[j] for j in ("FL_calf", "FR_calf", "RR_calf")) > 1.0
    assert run.base["pos"][-1, 0] - run.base["pos"][0, 0] > 0.3
    assert sum(x.mean() for x in run.feet.values()) == pytest.approx(12.6 * 9.81, rel=0.1)


def test_every_effect_of_the_listing_can_be_asked_for() -> None:
    """By its own form."""
    for name, effect in EFFECTS.items():
        place = {"joint": "FL_hip", "device": "FL_calf", "body": "FL_shank", "foot": "FL", "channel": "imu"}
        size = f"{0.5 * (effect.low + effect.high):g}" if effect.low < effect.high else ""
        text = f"{name}={':'.join(x for x in (place.get(effect.kind, ''), size) if x)}"
        assert parse_hidden(text, PLACES)[0].cause == name


def test_an_arm_is_recorded_from_its_mjcf(tmp_path: Path) -> None:
    """With gains by the inertia that each joint moves; where its joints swing, they follow."""
    (tmp_path / "arm.xml").write_text(ARM)
    cfg = LogCfg(robot=str(tmp_path / "arm.xml"), motions=(("chirp", 3.0),), hide=("link_mass=lower:0.2",))
    record(cfg, tmp_path / "log")
    log = load_log(tmp_path / "log")
    (run,) = log.runs
    assert log.base == "fixed" and log.joints == JOINTS and log.kp.min() > 0.0 and "kp" not in run.joint
    moved, asked = (np.ptp(run.joint[channel], axis=0) for channel in ("q", "q_des"))
    assert np.all(moved > 0.2 * asked) and np.all(moved < 2.0 * asked)


def test_an_imported_arm_is_recorded(tmp_path: Path) -> None:
    """With the gains that stand in its USD file, and the same joints; it stands on no feet."""
    (tmp_path / "arm.xml").write_text(ARM)
    out, log = str(tmp_path / "arm.usda"), str(tmp_path / "log")
    choices = ["--torque-limit", "*=30", "--kp", "*=50", "--unlimited", "*"]
    assert main(["robot", "import", str(tmp_path / "arm.xml"), "--out", out, *choices]) == 0
    assert main(["log", "record", "--robot", out, "--motion", "chirp=2", "--out", log]) == 0
    found = load_log(tmp_path / "log")
    assert found.base == "fixed" and found.joints == JOINTS and found.kp.tolist() == [50.0] * len(JOINTS)
    assert np.all(np.ptp(found.runs[0].joint["q"], axis=0) > 0.05)
    assert main(["log", "record", "--robot", out, "--motion", "squat=2", "--out", log, "--overwrite"]) == 2


def test_a_large_robot_walks_by_its_own_clock() -> None:
    """Twice as high: strides, speeds and turns in its units, as it was trained."""
    d = describe("mr_go")
    d.scales = Scales(length=2.0)
    motion = make_motion("walk", d, np.random.default_rng(1), 3.0, OnnxPolicy(DEFAULT_POLICY), None)
    assert isinstance(motion, Walk)
    assert motion.frequency == pytest.approx(1.5 / 2**0.5) and motion.speeds == pytest.approx(
        (0.2 * 2**0.5, 0.6 * 2**0.5)
    )


def test_commands_whose_stamps_are_two_rows_late_are_those_of_two_rows_before() -> None:
    """For every row, though times in floating point miss each other by their last digit."""
    t, asked = np.arange(2400) * 0.005, np.arange(2400.0)[:, None]
    _, found = sense(Clean(t=t, columns={"q_des": asked}), {"commands": 0.01}, 0.0, np.random.default_rng(0))
    assert np.array_equal(found["q_des"][2:], asked[:-2])
