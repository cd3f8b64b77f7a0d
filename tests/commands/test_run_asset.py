"""``mrwarp asset``: show, set, check, diff, apply and export; refusals write nothing; files of other USD tools load."""

import difflib
import itertools
import re
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.env.asset_trial import convert
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.params import MrParams
from mrwarp.usd.asset import load_robot
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS
from mrwarp.usd.robot import CALVES, STAND_HEIGHT
from mrwarp.usd.scene_report import check_asset
from tests.messages import Refused, has_parts

SHIPPED = ASSETS / "mr_go.usda"
VARIANTS = list(itertools.product(("mr_go", "go1"), (0, 3)))
K1 = "double newton:mr:K1 = 10.413315"


@pytest.fixture
def robot(tmp_path: Path) -> Path:
    """A copy of the robot's file, alone in its folder."""
    return Path(shutil.copy(SHIPPED, tmp_path / "robot.usda"))


def replaced(path: Path, old: str, new: str) -> Path:
    """The file with one text replaced; the text must occur."""
    text = path.read_text(encoding="utf-8")
    assert old in text
    path.write_text(text.replace(old, new), encoding="utf-8")
    return path


def changed_lines(path: Path) -> list[str]:
    """Lines of the robot's file that went (-) and came (+), without indentation."""
    old, new = (p.read_text(encoding="utf-8").splitlines() for p in (SHIPPED, path))
    return [line[:2] + line[2:].strip() for line in difflib.ndiff(old, new) if line[0] in "+-"]


def mr(path: Path, **variant) -> dict[str, MrParams]:
    """Parameters of the MR joints of a file."""
    return {a.joint: a.mr for a in load_robot(path, **variant).actuators if a.mr is not None}


def test_show_lists_joints_and_masses(capsys):
    """All joints with prim and gains, every MR number of the first device, bodies and the total mass."""
    assert main(["asset", "show"]) == 0
    out = capsys.readouterr().out
    assert "total                12.6 kg" in out
    assert out.count("/mr_go/actuators/") == 12
    assert out.count("MR numbers as FL_calf") == 3
    for spec in MrParams.specs():
        [line] = [line for line in out.splitlines() if line.split()[:1] == [spec.name]]
        for word in (f"{spec.unit}  ", f"default {spec.default:.10g}", "class MRDevice", spec.source):
            assert word in line
        assert "*" not in line
    assert main(["asset", "show", "--full"]) == 0
    assert capsys.readouterr().out.count("K1 ") == 4
    assert main(["asset", "show", "--robot", "go1", "--payload", "3"]) == 0
    assert "total                  15 kg" in capsys.readouterr().out
    assert main(["asset", "show", str(ASSETS / "mr_bench.usda")]) == 0
    assert "bench_joint" in capsys.readouterr().out


def test_set_one_leg(robot, capsys):
    """The documented command adds one line for that leg, in a new file; every other joint and variant stays."""
    out = robot.with_name("edited.usda")
    assert main(["asset", "set", str(robot), "FL_calf", "K1", "20.82663", "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "/mr_go/actuators/FL_calf newton:mr:K1: 10.413315 -> 20.82663 N·m/(rad·A)" in said
    assert robot.read_bytes() == SHIPPED.read_bytes()
    assert changed_lines(out) == ["+ double newton:mr:K1 = 20.82663"]
    paper = MrParams()
    assert mr(out) == {**dict.fromkeys(CALVES, paper), "FL_calf": paper.replace(K1=20.82663)}
    assert sorted(p.name for p in robot.parent.iterdir()) == ["edited.usda", "robot.usda"]
    main(["asset", "show", str(out)])
    [first, *others] = [line for line in capsys.readouterr().out.splitlines() if line.split()[:1] == ["K1"]]
    assert "* 20.82663" in first
    assert "FL_calf in robot=mr_go" in first
    assert len(others) == 3


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["FL_claf", "K1", "3"], ["there is no actuator 'FL_claf'", "did you mean 'FL_calf'"]),
        (["/mr_go/trunk", "K1", "3"], ["there is no actuator '/mr_go/trunk'", "known: MRDevice"]),
        (["FL_calf", "gama", "3"], ["/actuators/FL_calf", "'gama'", "did you mean 'gamma'", "-1e+09 to 1e+09 1/rad"]),
        (["FL_calf", "newton:mr:K1", "ten"], ["'ten' is not a number", "0 to 1e+15 N·m/(rad·A)"]),
        (["FL_calf", "K1", "nan"], ["K1 = nan"]),
        (["FL_calf", "K1", "-1e-3"], ["K1 = -0.001", "0 to 1e+15 N·m/(rad·A)"]),
        (["FL_hip", "K1", "3"], ["/mr_go/actuators/FL_hip", "plain motor", "newton:kp"]),
        (["FL_hip", "kd", "-1"], ["newton:kd = -1", "N·m·s/rad"]),
        (["MRDevice", "gamma", "-20"], ["robot.usda: ", "beta + gamma > 0", "nothing was written"]),
        (["FL_calf", "K1", "3", "--out", "nowhere/x.usda"], ["nowhere/x.usda: cannot be written", ".usda, .usdc"]),
        (["FL_calf", "K1", "3", "--out", "x.txt"], ["x.txt: cannot be written", "name ending in .usda"]),
    ],
)
def test_set_refuses(robot, capsys, words, expected):
    """A bad prim, name, number or target is one line on stderr, exit code 2, and nothing is written."""
    assert main(["asset", "set", str(robot), *words]) == 2
    said = capsys.readouterr()
    assert said.err.count("\n") == 1
    for word in ["mrwarp asset set: ", *expected]:
        assert word in said.err
    assert said.out == ""
    assert robot.read_bytes() == SHIPPED.read_bytes()
    assert [p.name for p in robot.parent.iterdir()] == ["robot.usda"]


def test_check_every_variant(robot, capsys):
    """A file that works gives a line for each variant; so does one with a dead leg."""
    assert main(["asset", "check", str(robot)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert [line.split()[:3] for line in lines] == [["ok", f"robot={r}", f"payload={p}"] for r, p in VARIANTS]
    assert "12 joints, 4 MR devices, 15.6 kg, 18 degrees of freedom" in lines[1]
    leg = 'over "RL_calf" (\n                    prepend inherits = </mr_go/parts/{}>'
    replaced(robot, leg.format("MRDevice"), leg.format("CalfMotor"))
    assert "12 joints, 3 MR devices, 12.6 kg" in next(check_asset(robot, convert))


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("physics:mass = 3\n", "physics:mass = -3\n", ["/mr_go/payload: physics:mass = -3.0 is not a positive number"]),
        ("float physics:mass = 0.68\n", "", ["/mr_go/FL_hip: physics:mass is missing", "above 0 kg"]),
        ('"3" {', '"three" {', ["variant payload = 'three' is not a whole number of kg"]),
        ("(0.0089, 0.0125, 0.0164)", "(-1, 0.0125, 0.0164)", ["/mr_go/payload: physics:diagonalInertia = (-1, 0.0125"]),
        ("(0.0089, 0.0125, 0.0164)", "(9, 0.0125, 0.0164)", ["(9, 0.0125, 0.0164) is no body's", "sum of the others"]),
        ("(0.0089, 0.0125, 0.0164)", "(nan, nan, nan)", ["(nan, nan, nan) is no body's"]),
        ("body1 = </mr_go/RR_calf>", "body1 = </mr_go/none>", ["robot=mr_go payload=0: Newton cannot convert it: "]),
    ],
)
def test_check_refuses(robot, refused, old, new, expected):
    """A fault in any variant is one line with the place; exit code 2."""
    replaced(robot, old, new)
    said = refused("asset", "check", robot)
    assert all(word in said for word in [str(robot), *expected]), said


def test_diff(robot, capsys):
    """Nothing differs: 0. Numbers that differ: 1, with units, and the variants if not all."""
    assert main(["asset", "diff", str(SHIPPED), str(robot)]) == 0
    assert capsys.readouterr().out == ""
    replaced(robot, "float physics:lowerLimit = -49.44625772", "float physics:lowerLimit = -40")
    replaced(robot, "physics:mass = 3\n", "physics:mass = 4\n")
    edit_asset(robot, "FL_calf", {"K1": 20.82663})
    edit_asset(robot, "RR_hip", {"kp": 30})
    assert main(["asset", "diff", str(SHIPPED), str(robot)]) == 1
    lines = capsys.readouterr().out.splitlines()
    mr_go = "[robot=mr_go payload=0; robot=mr_go payload=3]"
    assert f"actuators/FL_calf newton:mr:K1: 10.413315 -> 20.82663 N·m/(rad·A)   {mr_go}" in lines
    assert "actuators/RR_hip newton:kp: 35 -> 30 N·m/rad" in lines
    assert "joints/FL_hip physics:lowerLimit: -49.44626 -> -40 deg" in lines
    assert "payload physics:mass: 3 -> 4 kg   [robot=mr_go payload=3; robot=go1 payload=3]" in lines
    assert len(lines) == 7


@pytest.mark.parametrize("value", ["</x>", '"abc"', "(1, 2)"])
def test_an_inertia_of_another_type_is_refused(tmp_path: Path, refused: Refused, value: str) -> None:
    """USD's parser takes a path for any type, and a text where the type says so."""
    kind = {"</x>": "float3", '"abc"': "string", "(1, 2)": "float2"}[value]
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    path = tmp_path / "a.usda"
    path.write_text(re.sub(r"float3 (physics:diagonalInertia) = .*", rf"{kind} \1 = {value}", text), encoding="utf-8")
    assert "physics:diagonalInertia" in refused("asset", "show", path)


LINK = "(0, 0, -0.213)"


def test_a_robot_with_longer_links_starts_on_the_ground(robot):
    """Links of 0.25 m pass the check, and the height that episodes begin at follows from them."""
    replaced(robot, LINK, "(0, 0, -0.25)")
    assert main(["asset", "check", str(robot)]) == 0
    env = WalkEnv(replace(TaskCfg(num_envs=2), asset=str(robot), randomize=None))
    soles = env.root_pos[:, 2].numpy()[:, None] + env.sim.scene.soles[:, 2]
    assert np.all((soles > 0.0) & (soles < 0.011))
    assert env.sim.scene.stand_height == 0.388
    assert WalkEnv(replace(TaskCfg(num_envs=1), randomize=None)).sim.scene.stand_height == STAND_HEIGHT


@pytest.mark.parametrize(
    ("old", "new", "count", "words"),
    [
        ("lowerLimit = -161.45950667", "lowerLimit = -40", 1, "lowerLimit = -40.0 .. below .. exchange"),
        ("lowerLimit = -161.45950667", "lowerLimit = nan", 1, "lowerLimit = nan .. number below"),
        ("upperLimit = -50.87865221", "upperLimit = -90", 1, "stance of FL_calf, -85.94 deg .. widen"),
        (LINK, "(0, 0, -0.05)", -1, "trunk is 0.096 m high .. more than 0.16 m .. correct the links"),
        (f"localPos0 = {LINK}", "localPos0 = (0, 0, -0.15)", 1, "feet are not level: FL -0.2"),
        ("localPos0 = (-0.1881,", "localPos0 = (0.15,", -1, "feet span .. centre of mass is outside them"),
    ],
)
def test_a_robot_that_cannot_stand_is_refused(robot, refused, old, new, count, words):
    """Limits exchanged, no number or around another stance, legs short or uneven, feet not under the body."""
    text = robot.read_text(encoding="utf-8")
    assert old in text
    robot.write_text(text.replace(old, new, count), encoding="utf-8")
    said = refused("asset", "check", robot)
    assert said.startswith(f"mrwarp asset check: {robot}: ") and has_parts(said, words)
