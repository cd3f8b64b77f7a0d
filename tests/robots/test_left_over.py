"""Parts of a file that are not carried are named: nothing of it can be dropped unseen."""

import json
import re
import xml.etree.ElementTree as ET
from collections.abc import Callable, Mapping
from dataclasses import asdict
from enum import Enum
from itertools import pairwise
from pathlib import Path

import mujoco
import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from mrwarp.cli import main
from mrwarp.robots.drives import Choices
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.second import left_over as left

ARM = """<mujoco><default><default class="stiff"><joint {in_default}/></default></default><worldbody><body name="base">
<geom size=".05"/><body name="l1" pos="0 0 .1" {body}><joint name="j1" class="stiff" axis="0 1 0" range="-1 1" {joint}/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
MOTOR = '<motor name="a" joint="j1" ctrlrange="-5 5"/>'
SERVO = '<position name="a" joint="j1" kp="50" kv="1" forcerange="-20 20" {more}/>'
GENERAL = '<general joint="j1" biastype="affine" gainprm="{gain}" biasprm="{bias}" forcerange="-9 9"/>'

CASES = {
    "delay": ({"actuator": SERVO.format(more='delay="0.02" nsample="20"')}, "position delay (a: 0.02)"),
    "time constant": ({"actuator": SERVO.format(more='timeconst="0.05"')}, "position timeconst (a: 0.05)"),
    "gravity compensation": ({"body": 'gravcomp="0.7"'}, "body gravcomp (l1: 0.7)"),
    "friction": ({"joint": 'frictionloss="0.4"'}, "joint frictionloss (j1: 0.4)"),
    "spring": ({"joint": 'stiffness="6"'}, "joint stiffness (j1: 6)"),
    "a default": ({"in_default": 'frictionloss="0.4"'}, "joint frictionloss (stiff: 0.4)"),
    "damping that no servo takes": ({"joint": 'damping="0.3"'}, "joint damping (j1: 0.3)"),
    "the same by default": ({"in_default": 'damping="0.3"'}, "joint damping (j1: 0.3)"),
    "damping that grows with speed": (
        {"joint": 'damping="0.3 0.2 0.05"'},
        "joint damping beyond its linear term (j1: 0.3 0.2 0.05)",
    ),
    "a spring that stiffens": ({"joint": 'stiffness="6 0 3"'}, "joint stiffness (j1: 6 0 3)"),
    "damping of an actuator": ({"actuator": SERVO.format(more='damping="0 0.2"')}, "position damping (a: 0 0.2)"),
    "velocity": (
        {"actuator": '<velocity joint="j1" kv="3" gear="2" forcerange="-9 9"/>'},
        "velocity actuators were left out: 12 N·m·s/rad of j1",
    ),
    "an unknown kind": (
        {"actuator": '<intvelocity joint="j1" kp="5" actrange="-1 1" forcerange="-9 9"/>'},
        "<intvelocity> (joint=j1 kp=5 actrange=-1 1",
    ),
    "asymmetry": ({"actuator": MOTOR.replace("-5", "-20")}, "-20 to 5 of j1"),
    "asymmetry of the joint": ({"joint": 'actuatorfrcrange="-9 3"'}, "-9 to 3 of j1"),
    "range of commands": ({"actuator": SERVO.format(more='ctrlrange="-.5 .5"')}, "commands were left out: -0.5 to 0.5"),
    "constant torque": (
        {"actuator": GENERAL.format(gain=50, bias="2 -50 -1")},
        "constant torques of actuators were left out: 2 N·m of j1",
    ),
    "a command in other units": (
        {"actuator": GENERAL.format(gain=10, bias="0 -50 -1")},
        "10 for a command, 50 for an angle of j1",
    ),
    "a servo behind a gear": (
        {"actuator": '<position joint="j1" kp="20" gear="-2" forcerange="-9 9"/>'},
        "-40 for a command, 80 for an angle of j1",
    ),
    "a muscle": ({"actuator": '<muscle joint="j1" forcerange="-9 9"/>'}, "gain_muscle and bias_muscle of j1"),
    "back-EMF": (
        {"actuator": '<dcmotor joint="j1" motorconst="0.05" resistance="0.5" gear="10" ctrlrange="-24 24"/>'},
        "0.5 N·m·s/rad of j1",
    ),
}


@pytest.mark.parametrize("what", CASES)
def test_what_an_mjcf_says_is_carried_or_named(what: str, tmp_path: Path) -> None:
    """Attributes of bodies, joints, defaults and actuators."""
    parts, named = CASES[what]
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(**{"in_default": "", "body": "", "joint": "", "actuator": MOTOR, **parts}))
    understood = understand(read_robot(path), Choices(torque_limit={"*": 9.0}))
    assert any(named in note and "[omitted" in note for note in understood.notes), understood.notes


def test_the_torque_limit_of_a_dc_motor(tmp_path: Path) -> None:
    """Volts times constant over resistance, times the gear: 24 · 0.05 / 0.5 · 10."""
    path = tmp_path / "arm.xml"
    actuator = CASES["back-EMF"][0]["actuator"]
    path.write_text(ARM.format(in_default="", body="", joint="", actuator=actuator))
    assert read_robot(path).joints[0].torque_limit == pytest.approx(24.0)


def test_includes_are_walked(tmp_path: Path) -> None:
    """The file that is included is no part of the text."""
    servo = SERVO.format(more='timeconst="0.05"')
    (tmp_path / "motors.xml").write_text(f"<mujoco><actuator>{servo}</actuator></mujoco>")
    text = ARM.format(in_default="", body="", joint="", actuator="")
    (tmp_path / "arm.xml").write_text(text.replace("<worldbody>", '<include file="motors.xml"/><worldbody>'))
    assert "position timeconst (a: 0.05)" in left.left_over(tmp_path / "arm.xml")


def test_what_a_urdf_says(tmp_path: Path) -> None:
    """Velocity limits, friction, and elements of other programs."""
    limit = '<limit effort="3" velocity="9" lower="0" upper="1"/><dynamics friction="0.2"/>'
    joint = f'<joint name="8" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
    path = tmp_path / "arm.urdf"
    path.write_text(
        f'<robot name="r"><link name="a"/><link name="b"/>{joint}<gazebo><ratio>50</ratio></gazebo>'
        '<transmission name="t"/></robot>'
    )
    assert left.left_over(path) == (
        "limit velocity (8: 9); <dynamics> (8: friction=0.2); <gazebo> (ratio=50); <transmission> (t)"
    )


def test_what_a_usd_says(tmp_path: Path) -> None:
    """Attributes of other engines."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "arm.usda"))
    body = UsdGeom.Xform.Define(stage, "/arm").GetPrim()
    UsdPhysics.MassAPI.Apply(body).CreateMassAttr(1.0)
    body.CreateAttribute("physxRigidBody:linearDamping", Sdf.ValueTypeNames.Float).Set(0.1)
    stage.Save()
    assert left.left_over(tmp_path / "arm.usda") == "physxRigidBody:linearDamping (arm: 0.1)"


@pytest.mark.parametrize(("read", "root"), [(left.MJCF, "mujoco"), (left.URDF, "robot")])
def test_an_unknown_attribute_of_any_element_is_named(read: dict[str, set[str]], root: str, tmp_path: Path) -> None:
    """On every element that is read, with its value; and an unknown element in each of them."""
    for kind in read:
        tags = [tag for tag in kind.split("/") if tag != root]
        top = inner = ET.Element(root)
        for tag in tags:
            inner = ET.SubElement(inner, tag)
        inner.set("strange", "17")
        ET.SubElement(inner, "stranger", weight="18")
        path = tmp_path / "robot.xml"
        path.write_bytes(ET.tostring(top))
        assert {f"{inner.tag} strange (17)", "<stranger> (weight=18)"} <= set(left.left_over(path).split("; ")), kind


def test_all_that_mujoco_knows_is_read_or_named(tmp_path: Path) -> None:
    """By the list of its own compiler: each attribute of each element that is read, and each other element."""
    stack: list[str] = []
    found: list[tuple[list[str], str]] = []
    for line in mujoco.mj_printSchema(False, False).splitlines():
        if head := re.match(r"( *)(\S+) \(.\)", line):
            stack = [*stack[: len(head[1]) // 3], head[2].replace("(world)", "")]
        found += [(stack, name) for name in (line[head.end() :] if head else line).split()]
    assert len(found) > 1000
    for tags, attribute in found:
        top = inner = ET.Element("mujoco")
        for tag in tags[1:]:
            inner = ET.SubElement(inner, tag)
        inner.set(attribute, "1")
        path = tmp_path / "robot.xml"
        path.write_bytes(ET.tostring(top))
        kinds = [left.MJCF.get("/".join(pair), left.MJCF.get(pair[1])) for pair in pairwise(["", *tags])]
        names = [f"{tags[-1]} {attribute}", *(f"<{tag}>" for tag in tags)]
        named = any(name in left.left_over(path) for name in names)
        assert named == (None in kinds or attribute not in (kinds[-1] or ())), (tags, attribute)


def test_what_is_drawn_is_named_apart(tmp_path: Path) -> None:
    """Without values, after all that moves something."""
    path = tmp_path / "robot.xml"
    drawn = (
        '<visual><map force="1"/></visual><worldbody><light pos="0 0 9"/><geom size=".1" rgba="1 0 0 1"/></worldbody>'
    )
    path.write_text(f'<mujoco>{drawn}<option gravity="0 0 -1.6"/></mujoco>')
    text = "<option> (gravity=0 0 -1.6); and, of drawing, memory and comments: <visual>, <light>, geom rgba"
    assert left.left_over(path) == text


def test_an_unknown_attribute_of_any_prim_is_named(tmp_path: Path) -> None:
    """Numbers, tokens and relations, on every type that is read and on one that is not."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "robot.usda"))
    for kind in (*left.USD_PRIMS, "PhysicsScene"):
        prim = stage.DefinePrim(f"/a{kind}", kind)
        prim.CreateAttribute(f"strange:{kind}number", Sdf.ValueTypeNames.Float).Set(17.0)
        prim.CreateAttribute(f"strange:{kind}token", Sdf.ValueTypeNames.Token).Set("some")
        prim.CreateRelationship(f"strange:{kind}other").SetTargets(["/other"])
    stage.Save()
    texts = set(left.left_over(tmp_path / "robot.usda").split("; "))
    for kind in (*left.USD_PRIMS, "PhysicsScene"):
        own = {
            f"strange:{kind}{what} (a{kind}: {x})"
            for what, x in (("number", 17), ("token", "some"), ("other", "other"))
        }
        assert own <= texts
    assert "<PhysicsScene> (aPhysicsScene)" in texts


TURNS = {"quat": "1 1 0 0", "axisangle": "1 0 0 40", "xyaxes": "0 1 0 -1 0 0", "zaxis": "1 0 0", "euler": "40 0 0"}
RANGES = {"ctrlrange": "-3 3", "gear": "3", "joint": "j2", "armature": ".1"}
FORCES = {"forcerange": "-2 2", "forcelimited": "false"}
CTRL, FORCE = {"ctrlrange": "-9 9"}, {"forcerange": "-8 8"}
TETRA, FACES = "0 0 0 .1 0 0 0 .1 0 0 0 .1", "0 2 1 0 1 3 0 3 2 1 2 3"
READ: dict[str, list[tuple[dict[str, str], dict[str, str]]]] = {
    "body": [({}, TURNS | {"pos": "0 1 0"})],
    "inertial": [
        (
            {"pos": "0 0 .1", "mass": "1", "diaginertia": "1 1.4 1.5"},
            TURNS | {"pos": "0 1 0", "mass": "2", "diaginertia": "1 1.2 1.5"},
        ),
        ({"pos": "0 0 .1", "mass": "1", "fullinertia": "1 1 1 0 0 0"}, {"fullinertia": "1 1 1 .1 0 0"}),
    ],
    "joint": [
        (
            {"range": "-40 40", "actuatorfrcrange": "-4 4", "axis": "0 1 0"},
            {"type": "slide", "pos": "0 0 1", "axis": "1 0 0", "range": "-30 30", "limited": "false", "ref": "10"}
            | {"armature": ".2", "damping": ".3", "actuatorfrcrange": "-3 3", "actuatorfrclimited": "false"},
        )
    ],
    "geom": [
        (
            {"size": ".1 .2 .3", "type": "box"},
            TURNS
            | {"pos": "0 1 0", "type": "ellipsoid", "size": ".2 .2 .3", "mass": "3", "density": "5", "friction": ".3"},
        ),
        ({"size": ".1", "contype": "0"}, {"conaffinity": "0"}),
        ({"size": ".1", "conaffinity": "0"}, {"contype": "0"}),
        ({"size": ".1", "type": "capsule", "fromto": "0 0 0 0 0 1"}, {"fromto": "0 0 0 1 1 0"}),
        ({"mesh": "m", "type": "box"}, {"mesh": "m2", "fitscale": ".5"}),
        ({"size": ".1"}, {"shellinertia": "true"}),
    ],
    "mesh": [
        (
            {"name": "m", "vertex": TETRA, "face": FACES},
            {"scale": "2 2 2", "refpos": "1 0 0", "refquat": "1 1 0 0", "inertia": "shell"}
            | {"vertex": TETRA.replace(".1", ".2"), "face": FACES[:-6]},
        ),
        ({"name": "m", "builtin": "sphere", "params": "1"}, {"params": "2", "builtin": "hemisphere"}),
    ],
    "equality/connect": [
        ({"body1": "l1", "body2": "l2", "anchor": "0 0 0"}, {"body1": "base", "body2": "base", "active": "false"}),
        ({"site1": "s1", "site2": "s2"}, {"site1": "s0", "site2": "s0"}),
    ],
    "equality/weld": [
        ({"body1": "l1", "body2": "l2"}, {"body1": "base", "body2": "base", "active": "false"}),
        ({"site1": "s1", "site2": "s2"}, {"site1": "s0", "site2": "s0"}),
    ],
    "equality/joint": [({"joint1": "j1", "joint2": "j2"}, {"joint1": "j3", "joint2": "j3", "active": "false"})],
    "motor": [
        ({"joint": "j1"} | CTRL | FORCE, RANGES | FORCES),
        ({"joint": "j1"} | CTRL, RANGES | {"ctrllimited": "false"}),
    ],
    "position": [
        ({"joint": "j1", "kp": "5"} | FORCE, RANGES | FORCES | {"kp": "6", "kv": "1", "dampratio": "1"}),
        ({"joint": "j1", "kp": "5"} | FORCE | CTRL, {"ctrllimited": "false"}),
        ({"joint": "j1", "kp": "5"} | FORCE, {"inheritrange": ".5"}),
    ],
    "general": [
        ({"joint": "j1", "biastype": "affine", "biasprm": "0 -5 -1", "gainprm": "5"} | FORCE, RANGES | FORCES),
        (
            {"joint": "j1", "biastype": "affine", "biasprm": "0 -5 -1", "gainprm": "5"} | FORCE,
            {"biasprm": "0 -6 -1", "gainprm": "6", "biastype": "none", "gaintype": "affine", "inheritrange": ".5"},
        ),
        ({"joint": "j1"} | CTRL, {"ctrllimited": "false"}),
    ],
    "dcmotor": [
        (
            {"joint": "j1", "motorconst": ".05", "resistance": ".5"} | CTRL,
            RANGES | {"ctrllimited": "false", "motorconst": ".06", "resistance": ".6"},
        )
    ],
    "velocity": [
        ({"joint": "j1", "kv": "3"} | FORCE, RANGES | FORCES | {"kv": "4"}),
        ({"joint": "j1"} | FORCE | CTRL, {"ctrllimited": "false"}),
    ],
    "key": [({"name": "home", "qpos": "0 0 0"}, {"name": "rest", "qpos": ".1 0 0"})],
}
"""Attributes that an element has, and such as must change what is read, one at a time."""


def read_with(kind: str, attributes: Mapping[str, str], path: Path) -> str:
    """Everything that is read of an arm in which one element has these attributes."""
    own = " ".join([f"<{kind.rpartition('/')[2]}", *(f'{name}="{value}"' for name, value in attributes.items())])
    here = {k: f"{own}/>" if k == kind else "" for k in READ}
    mass = here["inertial"] or '<inertial pos="0 0 .1" mass="1" diaginertia="1 1.4 1.5"/>'
    body = own if kind == "body" else '<body pos="0 0 .2"'
    joint = f'{own} name="j1"/>' if kind == "joint" else '<joint name="j1" axis="0 1 0" range="-40 40"/>'
    meshes = f'<mesh name="m2" vertex="{TETRA.replace(".1", ".3")}"/>' + (
        here["mesh"] or f'<mesh name="m" vertex="{TETRA}"/>'
    )
    drawn = '<geom type="mesh" mesh="m" mass=".1"/>' * (kind == "mesh")
    ball = '<geom size=".1"/>'
    shape = here["geom"] or ball
    tied = "".join(here[k] for k in here if k.startswith("equality"))
    motors = "".join(here[k] for k in ("motor", "position", "general", "dcmotor", "velocity"))
    link = '<body name="l{0}" pos="0 0 .3"><joint name="j{0}" axis="0 1 0" range="-50 50"/><site name="s{0}"/>{1}'
    path.write_text(
        f'<mujoco><asset>{meshes}</asset><worldbody><body name="base">{ball}<site name="s0"/>{body} name="l1">'
        f'{joint}<site name="s1"/>{mass if kind != "geom" and kind != "mesh" else ""}{shape}{drawn}'
        f"{link.format(2, ball)}{link.format(3, ball)}</body></body></body></body></worldbody>"
        f"<equality>{tied}</equality><actuator>{motors}</actuator><keyframe>{here['key']}</keyframe></mujoco>"
    )
    robot = read_robot(path)
    return json.dumps(
        asdict(robot),
        default=lambda x: getattr(x, "as_matrix", lambda: x)().tolist() if not isinstance(x, Path | Enum) else str(x),
    )


@pytest.mark.parametrize("kind", READ)
def test_what_is_struck_out_is_read(kind: str, tmp_path: Path) -> None:
    """Each attribute that the list calls read changes what is read."""
    seen = {"name", "class", "childclass"}
    for k, (attributes, changes) in enumerate(READ[kind]):
        before = read_with(kind, attributes, tmp_path / "robot.xml")
        for name, value in changes.items():
            assert read_with(kind, {**attributes, name: value}, tmp_path / "robot.xml") != before, (k, name)
        seen |= set(changes)
    assert set(left.MJCF[kind]) <= seen | {"file", "anchor", "maxhullvert"}


def test_the_keyframe_that_was_taken_is_named(robot: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    """Of several, too."""
    path = robot(keyframe=[0.0, 0.6, -1.2] * 4)
    assert main(["robot", "import", str(path), "--out", str(path.with_suffix(".usda"))]) == 0
    assert "note: keyframe home is the stance" in capsys.readouterr().out
