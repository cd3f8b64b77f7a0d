"""Parts of a file that are not carried are named: nothing of it can be dropped unseen."""

from collections.abc import Callable
from pathlib import Path

import pytest
from pxr import Sdf, Usd, UsdGeom, UsdPhysics

from mrwarp.cli import main
from mrwarp.robots.drives import Choices
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.second.left_over import left_over

ARM = """<mujoco><default><default class="stiff"><joint {in_default}/></default></default><worldbody><body name="base">
<geom size=".05"/><body name="l1" pos="0 0 .1" {body}><joint name="j1" class="stiff" axis="0 1 0" range="-1 1" {joint}/>
<geom type="capsule" size=".02" fromto="0 0 0 .3 0 0" mass="1"/></body></body></worldbody>
<actuator>{actuator}</actuator></mujoco>"""
MOTOR = '<motor name="a" joint="j1" ctrlrange="-5 5"/>'
SERVO = '<position name="a" joint="j1" kp="50" kv="1" forcerange="-20 20" {more}/>'

CASES = {
    "delay": ({"actuator": SERVO.format(more='delay="0.02" nsample="20"')}, "position delay (a)"),
    "time constant": ({"actuator": SERVO.format(more='timeconst="0.05"')}, "position timeconst (a)"),
    "gravity compensation": ({"body": 'gravcomp="1"'}, "body gravcomp (l1)"),
    "friction": ({"joint": 'frictionloss="0.4"'}, "joint frictionloss (j1)"),
    "a default": ({"in_default": 'frictionloss="0.4"'}, "joint frictionloss (stiff)"),
    "damping that no servo takes": ({"joint": 'damping="0.3"'}, "joint damping (j1)"),
    "velocity": ({"actuator": '<velocity joint="j1" kv="3" forcerange="-9 9"/>'}, "velocity actuators"),
    "an unknown kind": ({"actuator": '<intvelocity joint="j1" kp="5" actrange="-1 1" forcerange="-9 9"/>'}, "<intvel"),
    "asymmetry": ({"actuator": MOTOR.replace("-5", "-20")}, "-20 to 5 of j1"),
    "back-EMF": (
        {"actuator": '<dcmotor joint="j1" motorconst="0.05" resistance="0.5" gear="10" ctrlrange="-24 24"/>'},
        "0.5 N·m·s/rad at j1",
    ),
}


@pytest.mark.parametrize("what", CASES)
def test_what_an_mjcf_says_is_carried_or_named(what: str, tmp_path: Path) -> None:
    """Attributes of bodies, joints, defaults and actuators."""
    parts, named = CASES[what]
    path = tmp_path / "arm.xml"
    path.write_text(ARM.format(**{"in_default": "", "body": "", "joint": "", "actuator": MOTOR, **parts}))
    understood = understand(read_robot(path), Choices())
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
    assert "position timeconst (a)" in left_over(tmp_path / "arm.xml")


def test_what_a_urdf_says(tmp_path: Path) -> None:
    """Velocity limits, friction, and elements of other programs."""
    limit = '<limit effort="3" velocity="9" lower="0" upper="1"/><dynamics friction="0.2"/>'
    joint = f'<joint name="8" type="revolute"><parent link="a"/><child link="b"/>{limit}</joint>'
    path = tmp_path / "arm.urdf"
    path.write_text(f'<robot name="r"><link name="a"/><link name="b"/>{joint}<gazebo/><transmission name="t"/></robot>')
    assert left_over(path) == "limit velocity (8); <dynamics> (8); <gazebo>; <transmission> (t)"


def test_what_a_usd_says(tmp_path: Path) -> None:
    """Attributes of other engines."""
    stage = Usd.Stage.CreateNew(str(tmp_path / "arm.usda"))
    body = UsdGeom.Xform.Define(stage, "/arm").GetPrim()
    UsdPhysics.MassAPI.Apply(body).CreateMassAttr(1.0)
    body.CreateAttribute("physxRigidBody:linearDamping", Sdf.ValueTypeNames.Float).Set(0.1)
    stage.Save()
    assert left_over(tmp_path / "arm.usda") == "physxRigidBody:linearDamping (arm)"


def test_the_keyframe_that_was_taken_is_named(robot: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    """Of several, too."""
    path = robot(keyframe=[0.0, 0.6, -1.2] * 4)
    assert main(["robot", "import", str(path), "--out", str(path.with_suffix(".usda"))]) == 0
    assert "note: keyframe home is the stance" in capsys.readouterr().out
