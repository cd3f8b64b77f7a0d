"""Robots as users have them: sprawling, on wheels, with toes, a spine, a tail; understood, or refused by name."""

import math
import re
from collections.abc import Callable, Sequence
from pathlib import Path

import mujoco
import numpy as np
import pytest

from mrwarp.cli import main
from mrwarp.env.sim_model import build_scene
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import UnderstoodRobot, understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.usd.asset import load_robot

BALL = '<geom type="sphere" size="0.02" pos="0 0 -0.2"/>'
ROD = '<geom type="capsule" fromto="0 0 0 {end}" size="0.01"/>'
PLACES = {"FR": (0.2, -0.1), "FL": (0.2, 0.1), "RR": (-0.2, -0.1), "RL": (-0.2, 0.1)}


def body(name: str, at: str, joint: str, axis: str, limits: str, inner: str, mass: float = 0.3, more: str = "") -> str:
    """A body on a hinge."""
    inertia = f'<inertial pos="0 0 0" mass="{mass}" diaginertia="{0.002 * mass} {0.002 * mass} {0.002 * mass}"/>'
    limited = f'range="{limits}"' if limits else ""
    hinge = f'<joint name="{joint}" axis="{axis}" {limited}/>'
    return f'<body name="{name}" pos="{at}" {more}>{inertia}{hinge}{inner}</body>'


def leg(name: str, x: float, y: float, shank: str = BALL) -> str:
    """Hip, thigh and calf, 0.2 m each, as a dog's."""
    calf = body(f"{name}_calf", "0 0 -0.2", f"{name}_knee", "0 1 0", "-2.6 -0.5", shank)
    thigh = body(f"{name}_thigh", f"0 {math.copysign(0.05, y)} 0", f"{name}_pitch", "0 1 0", "-1.5 3", calf, 0.8)
    return body(f"{name}_hip", f"{x} {y} 0", f"{name}_roll", "1 0 0", "-0.8 0.8", thigh, 0.5)


def sprawling(name: str, angle: float, shank: str) -> str:
    """A leg of an insect: the first joint turns it about the vertical, and at 0 the femur lies flat."""
    tibia = body(f"{name}_tibia", "0.08 0 0", f"{name}_j3", "0 1 0", "-2 2", shank)
    femur = body(f"{name}_femur", "0.05 0 0", f"{name}_j2", "0 1 0", "-1.5 1.5", tibia)
    at = f"{0.12 * math.cos(angle)} {0.12 * math.sin(angle)} 0"
    return body(f"{name}_coxa", at, f"{name}_j1", "0 0 1", "-1 1", femur, more=f'euler="0 0 {angle}"')


def walker(name: str, y: float) -> str:
    """A leg with a foot and toes, its foot's body called as people call it."""
    toes = body(f"{name}_toe", "0.1 0 -0.06", f"{name}_toes", "0 1 0", "-0.7 0.7", BOX.format(at="0.03 0 0"))
    foot = body(f"{name}_foot", "0 0 -0.35", f"{name}_ankle", "0 1 0", "-1 1", BOX.format(at="0.03 0 -0.06") + toes)
    shin = body(f"{name}_shin", "0 0 -0.35", f"{name}_knee", "0 1 0", "0 2.3", foot, 2.0)
    return body(f"{name}_thigh", f"0 {y} 0", f"{name}_hip", "0 1 0", "-1.5 1.5", shin, 3.0)


def ant(name: str, number: int) -> str:
    """A leg that lies flat at 0: a hip about the vertical, and an ankle that bends it down."""
    foot = body(f"{name}_foot", "0.2 0 0", f"{name}_ankle", "0 1 0", "0.5 1.7", ROD.format(end="0.5 0 0"))
    angle = math.radians((-45.0, 45.0, -135.0, 135.0)[number])
    inner = ROD.format(end="0.2 0 0") + foot
    return body(f"{name}_leg", "0 0 0", f"{name}_hip", "0 0 1", "-0.7 0.7", inner, more=f'euler="0 0 {angle}"')


BOX = '<geom type="box" size="0.03 0.03 0.01" pos="{at}"/>'
CORNERS = "".join(
    f'<geom type="sphere" size="0.005" pos="{x} {y} -0.065"/>' for x in (-0.04, 0.08) for y in (-0.02, 0.02)
)
DOG = "".join(leg(name, *at) for name, at in PLACES.items())
SIX = {"lf": 1.0, "rf": -1.0, "lm": 1.5708, "rm": -1.5708, "lr": 2.1416, "rr": -2.1416}
WALKER = walker("left", 0.1) + walker("right", -0.1)
WHEEL = body(
    "{}_wheel", "0 0 -0.2", "{}_spin", "0 1 0", "", '<geom type="cylinder" size="0.07 0.02" euler="1.57 0 0"/>'
)


def tail(end: str) -> str:
    """Two links behind the trunk."""
    tip = body("tip", end, "tail_2", "0 1 0", "-1 1", ROD.format(end=end))
    return body("tail", "-0.3 0 0.05", "tail_1", "0 1 0", "-1 1", ROD.format(end=end) + tip)


def key(knee: float, pitch: float) -> str:
    """A keyframe of the dog."""
    return f'<keyframe><key name="rest" qpos="0 0 1 1 0 0 0 {f"0 {pitch} {knee} " * 4}"/></keyframe>'


def legs_of(found: UnderstoodRobot) -> dict[str, tuple[str, ...]]:
    """Joints by leg."""
    return {leg.name: leg.joints for leg in found.layout.legs}


DOG_LEGS = (("FL", "FR", "RL", "RR"), ("FL_roll", "FL_pitch", "FL_knee"))
"""Legs in their order, and joints of the first one."""

ROBOTS: dict[str, tuple[dict, Choices, Sequence[str], Sequence[str]]] = {
    # robot, choices, legs in their order, joints of the first one
    "eight legs": (
        {"inner": "".join(leg(f"leg{k}", 0.4 - 0.25 * (k // 2), 0.1 - 0.2 * (k % 2)) for k in range(8))},
        Choices(),
        tuple(f"leg{k}" for k in range(8)),
        ("leg0_roll", "leg0_pitch", "leg0_knee"),
    ),
    "an insect": (
        {"inner": "".join(sprawling(n, a, BALL) for n, a in SIX.items())},
        Choices(),
        tuple(SIX),
        ("lf_j1", "lf_j2", "lf_j3"),
    ),
    "an insect drawn flat": (
        {"inner": "".join(sprawling(n, a, BALL.replace("0 0 -0.2", "0.15 0 0")) for n, a in SIX.items())},
        Choices(),
        tuple(SIX),
        ("lf_j1", "lf_j2", "lf_j3"),
    ),
    "an ant, whose legs lie flat above its belly": (
        {
            "inner": '<geom type="sphere" size="0.15"/>' + "".join(ant(n, k) for k, n in enumerate(PLACES)),
            "limit": 50.0,
        },
        Choices(),
        ("FL", "FR", "RL", "RR"),
        ("FL_hip", "FL_ankle"),
    ),
    "balls at the corners of the soles": (
        {"inner": WALKER.replace(BOX.format(at="0.03 0 -0.06"), CORNERS), "limit": 100.0},
        Choices(),
        ("left", "right"),
        ("left_hip", "left_knee", "left_ankle"),
    ),
    "a gripper that closes a loop, held": (
        {
            "inner": DOG
            + body("a", "0.3 0 0.1", "finger_a", "0 1 0", "-1 1", ROD.format(end="0.1 0 0"))
            + body("b", "0.3 0 0.1", "finger_b", "0 1 0", "-1 1", ROD.format(end="0.1 0 0")),
            "more": '<equality><connect body1="a" body2="b" anchor="0.1 0 0"/></equality>',
        },
        Choices(fix=("finger_*",)),
        *DOG_LEGS,
    ),
    "wheels": (
        {"inner": "".join(leg(name, *at, shank=WHEEL.replace("{}", name)) for name, at in PLACES.items())},
        Choices(unlimited=("*_spin",)),
        *DOG_LEGS,
    ),
    "two joints a leg": (
        {"inner": DOG},
        Choices(fix=("*_roll",)),
        ("FL", "FR", "RL", "RR"),
        ("FL_pitch", "FL_knee"),
    ),
    "toes": ({"inner": WALKER}, Choices(), ("left", "right"), ("left_hip", "left_knee", "left_ankle")),
    "a waist": (
        {"inner": body("pelvis", "0 0 -0.1", "waist", "0 0 1", "-1 1", WALKER, 3.0)},
        Choices(),
        ("left", "right"),
        ("left_hip", "left_knee", "left_ankle"),
    ),
    "a spine": (
        {
            "inner": leg("FR", 0.2, -0.1)
            + leg("FL", 0.2, 0.1)
            + body("rear", "-0.1 0 0", "spine", "0 0 1", "-1 1", leg("RR", -0.1, -0.1) + leg("RL", -0.1, 0.1), 4.0)
        },
        Choices(),
        *DOG_LEGS,
    ),
    "a trunk drawn with y upwards": (
        {
            "root": 'euler="1.5708 0 0"',
            "inner": f'<body euler="-1.5708 0 0"><geom type="box" size="0.1 0.1 0.01" mass="1"/>{DOG}</body>',
        },
        Choices(),
        *DOG_LEGS,
    ),
    "a tail that hangs": (
        {"inner": DOG + tail("-0.01 0 -0.2")},
        Choices(pose={"tail_*": 0.9}),
        *DOG_LEGS,
    ),
    "one that looks backwards": (
        {"inner": DOG},
        Choices(forward="-x"),
        ("RR", "RL", "FR", "FL"),
        ("RR_roll", "RR_pitch", "RR_knee"),
    ),
    "a joint whose name ends others": (
        {"inner": DOG.replace('"FL_knee"', '"knee"')},
        Choices(),
        ("leg1", "leg2", "leg3", "leg4"),
        ("FL_roll", "FL_pitch", "knee"),
    ),
    "names that end with the leg": (
        {"inner": re.sub('joint name="(..)_([a-z]+)"', r'joint name="\2_\1"', DOG)},
        Choices(),
        ("FL", "FR", "RL", "RR"),
        ("roll_FL", "pitch_FL", "knee_FL"),
    ),
}


@pytest.mark.parametrize("what", ROBOTS)
def test_strange_robots_are_understood(file: Callable[..., Path], what: str) -> None:
    """Legs with their joints, in order; all feet on the ground, with nothing else in it."""
    robot, choices, legs, first = ROBOTS[what]
    found = understand(read_robot(file(**robot)), choices)
    assert tuple(legs_of(found)) == tuple(legs)
    assert next(iter(legs_of(found).values())) == tuple(first)
    poses = found.robot.poses(found.layout.neutral)
    soles = [poses[foot.body].apply(foot.centre)[2] - foot.radius for foot in found.feet]
    assert np.ptp(soles) < 0.002 and found.height == pytest.approx(-min(soles)) and found.height > 0.1


def test_a_sprawling_leg_stands_below_its_knee(file: Callable[..., Path]) -> None:
    """The femur turns upwards and outwards, the foot stands below its joint; all six equally."""
    found = understand(read_robot(file(**ROBOTS["an insect"][0])), Choices())
    angles = np.array([[found.layout.neutral[joint] for joint in joints] for joints in legs_of(found).values()])
    assert np.ptp(angles, axis=0).max() < 0.01 and abs(angles[0, 0]) < 0.01
    poses = found.robot.poses(found.layout.neutral)
    for foot in found.feet:
        out = float(np.linalg.norm(poses[foot.body].apply(foot.centre)[:2]))
        assert out == pytest.approx(0.17, abs=0.02)  # the femurs' joints are 0.12 + 0.05 m from the middle


@pytest.mark.parametrize("shift", [-0.0126, -0.0125, 0.0, 0.0374])
def test_two_feet_are_a_row_wherever_they_are(file: Callable[..., Path], shift: float) -> None:
    """A biped's feet move in turn, though a millimetre lies between them."""
    inner = WALKER.replace('pos="0 0.1 0"', f'pos="{shift} 0.1 0"').replace(
        'pos="0 -0.1 0"', f'pos="{shift - 1e-4} -0.1 0"'
    )
    found = understand(read_robot(file(inner, limit=100.0, kp=400.0)), Choices())
    assert [(leg.name, leg.phase) for leg in found.layout.legs] == [("left", 0.0), ("right", 0.5)]


def test_toes_and_a_foot_of_its_own_name_bear_load(file: Callable[..., Path], tmp_path: Path) -> None:
    """A body called left_foot may have that name; what the foot's body carries bears its load."""
    out = tmp_path / "toes.usda"
    assert main(["robot", "import", str(file(WALKER, limit=100.0, kp=400.0)), "--out", str(out)]) == 0
    scene = build_scene(load_robot(robot=str(out)), dt=0.005)
    assert scene.foot_adr.shape == (2,)
    spheres = [scene.model.geom_bodyid[geom] for geom in scene.feet]
    names = [scene.model.body(body).name for body in spheres]
    assert 0.4 < scene.layout.neutral["left_knee"] < 1.0  # a biped stands nearly upright
    assert [name.endswith(("left_foot", "right_foot")) for name in names] == [True, True]


def test_a_sole_of_balls_bears_load_as_a_whole(file: Callable[..., Path]) -> None:
    """The foot is the middle of its corners, equal on both sides; shapes of contact pairs are its sole too."""
    inner = WALKER.replace(BOX.format(at="0.03 0 -0.06"), CORNERS)
    first = understand(read_robot(file(inner, limit=100.0)), Choices())
    for foot in first.feet:
        assert foot.sole and foot.shape is None and foot.centre[:2] == pytest.approx((0.02, 0.0), abs=0.01)
    assert first.layout.neutral["left_knee"] == pytest.approx(first.layout.neutral["right_knee"], abs=0.002)
    bare = inner.replace("<geom", '<geom contype="0" conaffinity="0"').replace("-0.065", '-0.065" name="{}')
    while "{}" in bare:
        bare = bare.replace("{}", f"ball{bare.count('{}')}", 1)
    pairs = "".join(f'<pair geom1="ball{k + 1}" geom2="floor"/>' for k in range(bare.count('name="ball')))
    path = file(bare, limit=100.0, more=f"<contact>{pairs}</contact>")
    path.write_text(
        path.read_text().replace("<worldbody>", '<worldbody><geom name="floor" type="plane" size="9 9 1"/>')
    )
    assert all(foot.sole for foot in understand(read_robot(path), Choices()).feet)


def test_a_device_at_the_toes_has_no_gates_and_that_is_said(
    file: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A foot hangs below a knee, none below its toes."""
    out = tmp_path / "toes.usda"
    assert main(["robot", "import", str(file(WALKER, limit=100.0, kp=400.0)), "--out", str(out)]) == 0
    assert "no gates" not in capsys.readouterr().out
    assert main(["robot", "fit-device", str(out), "--joint", "*_toes", "*_knee"]) == 0
    said = capsys.readouterr().out.splitlines()
    rows = {line.split()[0]: line for line in said if "MR device," in line}
    assert [name for name, row in rows.items() if "no gates" in row] == ["left_toes", "right_toes"] and len(rows) == 4
    assert any(line.startswith("no gates: no foot of a leg hangs below left_toes, right_toes; ") for line in said)


def test_what_holding_the_stance_takes(file: Callable[..., Path]) -> None:
    """A leg bears a quarter of the weight, whose lever about the knee follows from the angles."""
    found = understand(read_robot(file(DOG)), Choices())
    note = next(note for note in found.notes if "to hold the stance" in note)
    q = found.layout.neutral
    mass = sum(body.mass for body in found.robot.bodies)
    lever = 0.2 * abs(math.sin(q["FL_pitch"] + q["FL_knee"]))
    above = 0.25 * mass - 0.3  # the calf's own mass lies at its joint
    assert float(note.split("needs ")[1].split()[0]) == pytest.approx(9.81 * lever * (above + 0.3), rel=0.1)
    weak = understand(read_robot(file(DOG, limit=2.0)), Choices())
    assert any("cannot hold the stance" in note for note in weak.notes)


def test_a_keyframe_that_is_no_stance(file: Callable[..., Path]) -> None:
    """With the trunk on the ground it is left, and the stance is solved; one that stands is kept."""
    lying = understand(read_robot(file(DOG, more=key(-2.6, 2.6))), Choices())
    assert lying.height > 0.25 and any("keyframe is no stance" in note for note in lying.notes)
    assert understand(read_robot(file(DOG, more=key(-1.4, 0.7))), Choices()).layout.neutral["FL_knee"] == -1.4


def test_feet_of_legs_whose_knees_are_held(file: Callable[..., Path]) -> None:
    """The balls are the feet in the stance, though knees that are held bent lie lower with the hips at 0."""
    thigh = ROD.format(end="0 0 -0.2")
    inner = DOG.replace('<inertial pos="0 0 0" mass="0.8"', f'{thigh}<inertial pos="0 0 0" mass="0.8"')
    found = understand(read_robot(file(inner, more=key(-2.0, 1.2))), Choices(fix=("*_knee",)))
    assert [foot.radius for foot in found.feet] == [0.02] * 4 and all(foot.shape is not None for foot in found.feet)


REFUSED: dict[str, tuple[dict, tuple[str, ...]]] = {
    "millimetres": (
        {"inner": DOG.replace("0 0 -0.2", "0 0 -200").replace("0 0.05 0", "0 50 0")},
        ("m high", "metres"),
    ),
    "a tail in the ground": ({"inner": DOG + tail("-0.01 0 -0.2")}, ("tip reaches", "--pose tail_2=RAD", "--fix")),
    "a leg without an end": (
        {"inner": "".join(leg(name, *at, shank="") for name, at in PLACES.items())},
        ("_calf", "no shape", "sphere"),
    ),
    "a loop": (
        {"inner": DOG, "more": '<equality><connect body1="FL_calf" body2="FL_hip" anchor="0 0 0"/></equality>'},
        ("<connect> closes a loop between FL_calf and FL_hip", "open it there", "--fix FL_pitch FL_knee"),
    ),
    "a ball joint": (
        {
            "inner": DOG.replace(
                '<joint name="FL_roll" axis="1 0 0" range="-0.8 0.8"/>', '<joint name="b" type="ball"/>'
            )
        },
        ("b is a ball joint", "hinges"),
    ),
}


@pytest.mark.parametrize("what", REFUSED)
def test_what_cannot_be_understood_says_where(file: Callable[..., Path], what: str) -> None:
    """Place and remedy."""
    robot, parts = REFUSED[what]
    path = file(**robot)
    if what == "a ball joint":
        path.write_text(path.read_text().replace('<position joint="b" kp="40.0" forcerange="-30.0 30.0"/>', ""))
    with pytest.raises(RobotFileError) as error:
        understand(read_robot(path), Choices())
    assert "\n" not in str(error.value) and all(part in str(error.value) for part in (str(path), *parts)), error.value


def test_several_hinges_of_one_body(file: Callable[..., Path]) -> None:
    """Links are put between them: all bodies are where they were, and as heavy; joints keep their order."""
    hinge = '<joint name="{leg}_yaw" axis="0 0 1" range="-0.5 0.5" pos="0 0 0.03" armature="0.01"/>'
    legs = "".join(
        leg(name, *at).replace(f'<joint name="{name}_roll"', hinge.format(leg=name) + f'<joint name="{name}_roll"')
        for name, at in PLACES.items()
    )
    path = file(legs)
    found, model = read_robot(path), mujoco.MjModel.from_xml_path(str(path))
    assert sum(b.mass for b in found.bodies) == pytest.approx(float(model.body_mass.sum()))
    names = [joint.name for joint in found.joints]
    assert [name.partition("_")[2] for name in names[:4]] == ["yaw", "roll", "pitch", "knee"]
    angles = dict(zip(names, np.linspace(-0.4, 0.5, len(names)), strict=True))
    data = mujoco.MjData(model)
    for name, q in angles.items():
        data.joint(name).qpos[:] = q
    mujoco.mj_kinematics(model, data)
    trunk = data.body("trunk")
    for part, place in zip(found.bodies, found.poses(angles), strict=True):
        if "yaw" not in part.name:
            expected = trunk.xmat.reshape(3, 3).T @ (data.body(part.name).xpos - trunk.xpos)
            np.testing.assert_allclose(place.translation, expected, atol=1e-9)
    layout = understand(found, Choices(torque_limit={"*": 30.0})).layout
    assert [len(own.joints) for own in layout.legs] == [4] * 4
