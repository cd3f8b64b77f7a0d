"""The second reading of a robot's file: that it agrees with the first, and that it stops what the first gets wrong."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from xml.etree import ElementTree as ET

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from mrwarp.cli import main
from mrwarp.robots import newton_robot
from mrwarp.robots.foreign import Body
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.second.body_sum import urdf_tree, usd_tree
from mrwarp.usd.asset import load_robot
from mrwarp.usd.open_stage import open_stage
from mrwarp.usd.robot_layout import read_notes
from tests.robots.test_foreign_files import urdf

HAND = """
<robot name="hand"><link name="palm"><inertial><mass value="2"/>{inertia}</inertial></link>
<link name="rod"><inertial><origin xyz="0 0 -0.1"/><mass value="0.5"/>{inertia}</inertial></link>
<link name="tip"><inertial><mass value="0.2"/>{inertia}</inertial></link>
<joint name="swing" type="revolute"><parent link="palm"/><child link="rod"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1.5" effort="6" velocity="5"/></joint>
<joint name="weld" type="fixed"><parent link="rod"/><child link="tip"/><origin xyz="0 0.1 -0.2" rpy="0.3 0 1"/>
{more}</joint>
</robot>
"""
INERTIA = '<inertia ixx="{}" iyy="{}" izz="{}" ixy="0" ixz="0" iyz="0"/>'


def hand(folder: Path, moments: tuple[float, float, float] = (0.01, 0.012, 0.013), more: str = "") -> Path:
    """An arm of one joint with a link on a fixed joint."""
    path = folder / "hand.urdf"
    path.write_text(HAND.format(inertia=INERTIA.format(*moments), more=more))
    return path


def imported(path: Path, *options: str) -> tuple[int, Path]:
    """Exit code and file of ``mrwarp robot import``."""
    out = path.with_suffix(".usda")
    return main(["robot", "import", str(path), "--out", str(out), "--base", "fixed", *options]), out


def test_a_wrong_merge_stops_the_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A merge that forgets the way to the new centre of mass, as Newton's: joint and both numbers are named."""

    def forgetful(parent: Body, child: Body, place) -> Body:  # noqa: ANN001
        right = joined(parent, child, place)
        return replace(right, inertia=right.inertia + child.mass * np.eye(3) * 0.05)

    from mrwarp.robots import foreign

    joined = foreign.joined
    monkeypatch.setattr(foreign, "joined", forgetful)
    code, out = imported(hand(tmp_path))
    said = capsys.readouterr().err
    assert code == 2 and not out.exists()
    assert "mass matrix at swing" in said and "what MuJoCo reads" in said and "nothing was written" in said


def test_a_wrong_limit_stops_the_import(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Limits of a joint that is turned round, and a torque limit that lost a gear."""
    read = newton_robot._joint

    def turned(*args: object):  # noqa: ANN202
        joint = read(*args)
        return replace(joint, limits=(-1.5, 1.0), torque_limit=60.0)

    monkeypatch.setattr(newton_robot, "_joint", turned)
    code, _ = imported(hand(tmp_path))
    said = capsys.readouterr().err
    assert code == 2 and "torque limit of swing [N·m] 60 against 6" in said and "and 1 more" in said


def test_moments_that_are_flat_to_rounding_are_taken(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A + B = C but for the last digits: MuJoCo refuses it, sums over the bodies do not."""
    code, out = imported(hand(tmp_path, (0.004, 0.006, 0.01 * (1.0 + 2e-10))))
    assert code == 0
    note = read_notes(load_robot(robot=str(out)).stage)[-1]
    assert "what sums over the bodies reads, within" in note


def test_a_mimic_on_a_fixed_joint_is_left_out_by_name(tmp_path: Path) -> None:
    """It follows nothing."""
    code, out = imported(hand(tmp_path, more='<mimic joint="swing"/>'))
    assert code == 0
    assert any("<mimic> of weld was left out" in note for note in read_notes(load_robot(robot=str(out)).stage))


@pytest.mark.parametrize("floating", [False, True])
@pytest.mark.parametrize("seed", range(3))
def test_sums_over_bodies_are_mujocos(seed: int, floating: bool, random_urdf: Callable[..., str]) -> None:
    """The reading for what MuJoCo cannot read, on random trees that it can."""
    text = random_urdf(np.random.default_rng(seed), held=False)
    tree = urdf_tree(ET.fromstring(text))
    if floating:
        ground = (
            '<link name="ground"/><joint name="f" type="floating"><parent link="ground"/><child link="l0"/></joint>'
        )
        text = text.replace("</robot>", f"{ground}</robot>")
    model = mujoco.MjModel.from_xml_string(text)
    data, matrix, pull = mujoco.MjData(model), np.zeros((model.nv, model.nv)), np.zeros(model.nv)
    angles = {model.joint(j).name: 0.3 * j - 1.0 for j in range(model.njnt) if model.joint(j).name != "f"}
    for name, angle in angles.items():
        data.joint(name).qpos[0] = angle
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, matrix)
    mujoco.mj_rne(model, data, 0, pull)
    own, weight = tree.dynamics(angles, floating, Rotation.identity())
    names = [tie.name for tie in tree.ties if tie.kind != "fixed"]
    first = 6 if floating else 0
    order = [*range(first), *(first + names.index(name) for name in angles)]
    np.testing.assert_allclose(own[np.ix_(order, order)], matrix, rtol=0, atol=1e-10 * np.abs(matrix).max())
    np.testing.assert_allclose(weight[order], pull, rtol=0, atol=1e-9 * np.abs(pull).max())


def test_the_shipped_robot_is_summed_from_its_stage() -> None:
    """Every mass of the file, none from shapes."""
    tree = usd_tree(open_stage(load_robot().path))
    assert tree is not None and sum(tie.kind == "hinge" for tie in tree.ties) == 12
    matrix, _ = tree.dynamics({}, True, Rotation.identity())
    assert matrix[0, 0] == pytest.approx(sum(link.mass for link in tree.links.values()))


MOUNT = '<joint name="mount" type="{}"><origin xyz="0 0 1" rpy="0.1 0.2 0.4"/><parent link="world"/>'


def mounted(path: Path, kind: str, trunk: str) -> Path:
    """A URDF whose trunk a tilted joint of the world bears."""
    more = f'<link name="world"/>{MOUNT.format(kind)}<child link="{trunk}"/></joint></robot>'
    path.write_text(path.read_text().replace("</robot>", more))
    return path


@pytest.mark.parametrize("top", [0.013, 0.0220000001])  # MuJoCo does not read the second
def test_a_mount_that_tilts_an_arm(top: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Axis and weight have the rotation of the base in the world, by both second readings."""
    path = mounted(hand(tmp_path, (0.01, 0.012, top)), "fixed", "palm")
    (swing,) = read_robot(path).joints
    tilted = Rotation.from_euler("xyz", [0.1, 0.2, 0.4]).apply([0.0, 1.0, 0.0])
    np.testing.assert_allclose(swing.in_parent.rotation.apply(swing.axis), tilted, atol=1e-6)
    code, _ = imported(path)
    said = capsys.readouterr()
    by = "MuJoCo" if top < 0.02 else "sums over the bodies"
    assert code == 0 and f"are what {by} reads, within" in said.out, said


@pytest.mark.parametrize("kind", ["fixed", "floating"])
def test_a_mount_that_tilts_a_dog(kind: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Up in the world is up for its trunk."""
    code, _ = imported(mounted(urdf(tmp_path), kind, "trunk"), "--base", "free")
    said = capsys.readouterr()
    assert code == 0 and "are what MuJoCo reads, within" in said.out, said


def test_choices_are_no_differences(robot: Callable[..., Path], capsys: pytest.CaptureFixture[str]) -> None:
    """Joints that are held, an axis that is forwards, rotors and limits of the user's."""
    path = robot()
    out = path.with_suffix(".usda")
    choices = ["--fix", "*_roll", "--forward", "y", "--armature", "*=0.02", "--torque-limit", "*=20"]
    code = main(["robot", "import", str(path), "--out", str(out), *choices])
    said = capsys.readouterr()
    assert code == 0, said.err
    assert "are what MuJoCo reads, within" in said.out


def two_joints(folder: Path, link: str, head: str = "") -> Path:
    """An arm of one body on two joints."""
    joints = "".join(f'<joint name="j{axis[0]}" axis="{axis}" range="-60 60"/>' for axis in ("1 0 0", "0 1 0"))
    motors = "".join(f'<motor joint="j{k}" ctrlrange="-5 5"/>' for k in (0, 1))
    path = folder / "arm.xml"
    path.write_text(
        f'<mujoco><compiler {head}/><worldbody><body name="base"><geom size=".05"/><body name="a" pos="0 0 .1">{joints}'
        f"{link}</body></body></worldbody><actuator>{motors}</actuator></mujoco>"
    )
    return path


@pytest.mark.parametrize("moments", ["2e-5 4e-3 4e-3", "2e-3 2e-3 4e-3", "4e-3 4e-3 4e-3"])
def test_two_joints_of_a_thin_or_flat_body(moments: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Newton leaves the light link between them, and the rest of the body, as they are."""
    link = f'<inertial pos=".1 0 0" mass=".5" diaginertia="{moments}"/>'
    code, _ = imported(two_joints(tmp_path, link))
    said = capsys.readouterr()
    assert code == 0 and "are what MuJoCo reads, within" in said.out, said


def test_warnings_of_libraries_are_notes_or_silent(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    recwarn: pytest.WarningsRecorder,
) -> None:
    """MuJoCo's of a deprecated attribute is one note; Newton's, of a moment that it raises, is none."""
    monkeypatch.setattr("mrwarp.usd.converted.cache_folder", lambda: None)
    tip = '<body pos=".3 .2 0"><joint name="tip" axis="0 1 0" range="-9 9"/>{}</body>'
    tip = tip.format('<inertial pos=".1 0 0" mass=".2" diaginertia="1e-11 1e-3 1e-3"/>')
    path = two_joints(tmp_path, f'<geom type="capsule" fromto="0 0 0 .3 0 0" size=".03"/>{tip}', 'settotalmass="1"')
    code, _ = imported(path, "--torque-limit", "tip=5")
    said = capsys.readouterr()
    assert code == 0 and not [str(w.message) for w in recwarn], said.err
    assert said.out.count("'settotalmass' is deprecated") == 1 and "MuJoCo reads the file, and warns:" in said.out


def test_the_note_says_what_the_weight_is_without(tmp_path: Path) -> None:
    """Gravity of the file, and bodies that it lets float, are neither in the robot nor in the comparison."""
    path = tmp_path / "arm.xml"
    path.write_text(
        '<mujoco><option gravity="0 0 -3.7"/><worldbody><body name="base"><geom size=".05"/><body gravcomp="1">'
        '<joint name="j" axis="0 1 0" range="-60 60"/><geom type="capsule" fromto="0 0 0 .3 0 0" size=".02"/></body>'
        '</body></worldbody><actuator><motor joint="j" ctrlrange="-5 5"/></actuator></mujoco>'
    )
    code, out = imported(path)
    note = read_notes(load_robot(robot=str(out)).stage)[-1]
    assert code == 0 and "weight at 9.81 m/s²" in note and "both without what is not carried" in note
