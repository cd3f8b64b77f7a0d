"""Robots from URDF and USD: what arrives, and what is refused in one line that says where and what to write."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from pxr import Gf, Sdf, Usd, UsdGeom, UsdPhysics
from scipy.spatial.transform import RigidTransform, Rotation

from mrwarp.cli import main
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import Joint
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.usd.asset import RobotAsset, load_robot, masses

PLACES = {"LF": (0.2, 0.1), "RF": (0.2, -0.1), "LH": (-0.2, 0.1), "RH": (-0.2, -0.1)}
SPHERE = '<collision><origin xyz="0 0 -0.2"/><geometry><sphere radius="0.02"/></geometry></collision>'
MESH = '<visual><geometry><mesh filename="{file}"/></geometry></visual>'
LIMIT = '<limit lower="-1" upper="1" effort="30" velocity="5"/>'


def link(name: str, *, mass: float | None = 1.0, more: str = "") -> str:
    """A link of a URDF."""
    inertia = '<inertia ixx="0.01" iyy="0.01" izz="0.01" ixy="0" ixz="0" iyz="0"/>'
    own = "" if mass is None else f'<inertial><mass value="{mass}"/>{inertia}</inertial>'
    return f'<link name="{name}">{own}{more}</link>'


def joint(name: str, parent: str, child: str, *, kind: str = "revolute", limit: str = LIMIT, at: str = "0 0 0") -> str:
    """A joint of a URDF, about y unless it is a HAA."""
    axis = "1 0 0" if name.endswith("HAA") else "0 1 0"
    ends = f'<parent link="{parent}"/><child link="{child}"/>'
    return f'<joint name="{name}" type="{kind}">{ends}<origin xyz="{at}"/><axis xyz="{axis}"/>{limit}</joint>'


def urdf(folder: Path, more: str = "", *, shank: float | None = 0.5, knee: str = "-2.5", names: str = "{}") -> Path:
    """A dog in URDF."""
    text = link("trunk", mass=8.0)
    for leg, (x, y) in PLACES.items():
        own = names.format(leg)
        text += link(f"{own}_hip") + link(f"{own}_thigh") + link(f"{own}_shank", mass=shank, more=SPHERE)
        text += joint(f"{own}_HAA", "trunk", f"{own}_hip", at=f"{x} {y} 0") + joint(
            f"{own}_HFE", f"{own}_hip", f"{own}_thigh"
        )
        limit = LIMIT.replace("-1", knee).replace('"1"', '"-0.1"')
        text += joint(f"{own}_KFE", f"{own}_thigh", f"{own}_shank", limit=limit, at="0 0 -0.2")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / "dog.urdf"
    path.write_text(f'<robot name="dog">{text}{more}</robot>', encoding="utf-8")
    return path


def camera(file: str) -> str:
    """A link on the trunk with a mesh."""
    return link("camera", more=MESH.format(file=file)) + joint("mount", "trunk", "camera", kind="fixed")


def usd(folder: Path, more: Callable[[Usd.Stage], None] = lambda stage: None) -> Path:
    """The dog in USD, with drives as USD's physics has them: stiffness per degree."""
    stage = Usd.Stage.CreateNew(str(folder / "dog.usda"))
    UsdGeom.SetStageUpAxis(stage, "Z")
    UsdGeom.SetStageMetersPerUnit(stage, 1.0)
    root = UsdGeom.Xform.Define(stage, "/dog").GetPrim()
    stage.SetDefaultPrim(root)
    UsdPhysics.ArticulationRootAPI.Apply(root)

    def body(name: str, at: tuple[float, float, float], mass: float) -> None:
        form = UsdGeom.Xform.Define(stage, f"/dog/{name}")
        form.AddTranslateOp().Set(Gf.Vec3d(*at))
        UsdPhysics.RigidBodyAPI.Apply(form.GetPrim())
        api = UsdPhysics.MassAPI.Apply(form.GetPrim())
        api.CreateMassAttr(mass)
        api.CreateDiagonalInertiaAttr(Gf.Vec3f(0.01))

    def hinge(name: str, ends: tuple[str, str], at: tuple[float, float, float], axis: str, low: float) -> None:
        made = UsdPhysics.RevoluteJoint.Define(stage, f"/dog/{ends[0]}/{name}")
        made.CreateBody0Rel().SetTargets([f"/dog/{ends[0]}"])
        made.CreateBody1Rel().SetTargets([f"/dog/{ends[1]}"])
        made.CreateAxisAttr(axis)
        made.CreateLocalPos0Attr(Gf.Vec3f(*at))
        made.CreateLowerLimitAttr(low)
        made.CreateUpperLimitAttr(-5.0 if low < -100.0 else 90.0)
        drive = UsdPhysics.DriveAPI.Apply(made.GetPrim(), "angular")
        drive.CreateStiffnessAttr(np.radians(40.0))
        drive.CreateDampingAttr(np.radians(1.0))
        drive.CreateMaxForceAttr(30.0)

    body("trunk", (0.0, 0.0, 0.5), 8.0)
    for leg, (x, y) in PLACES.items():
        body(f"{leg}_hip", (x, y, 0.5), 0.5)
        body(f"{leg}_thigh", (x, y, 0.5), 1.0)
        body(f"{leg}_shank", (x, y, 0.3), 0.5)
        ball = UsdGeom.Sphere.Define(stage, f"/dog/{leg}_shank/ball")
        ball.CreateRadiusAttr(0.02)
        ball.AddTranslateOp().Set(Gf.Vec3d(0.0, 0.0, -0.2))
        UsdPhysics.CollisionAPI.Apply(ball.GetPrim())
        hinge(f"{leg}_HAA", ("trunk", f"{leg}_hip"), (x, y, 0.0), "X", -90.0)
        hinge(f"{leg}_HFE", (f"{leg}_hip", f"{leg}_thigh"), (0.0, 0.0, 0.0), "Y", -90.0)
        hinge(f"{leg}_KFE", (f"{leg}_thigh", f"{leg}_shank"), (0.0, 0.0, -0.2), "Y", -150.0)
    more(stage)
    stage.Save()
    return folder / "dog.usda"


def imported(file: Path, *options: str) -> RobotAsset:
    """The robot of ``mrwarp robot import``."""
    out = file.with_name("out.usda")
    assert main(["robot", "import", str(file), "--out", str(out), "--overwrite", *options]) == 0
    return load_robot(robot=str(out))


def test_a_usd_robot_arrives_with_its_drives(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Masses, limits and gains of USD's physics; the table says what stands where, and what was guessed."""
    asset = imported(usd(tmp_path))
    assert asset.layout.leg_names == ("LF", "RF", "LH", "RH") and asset.layout.trunk == "trunk"
    assert sum(masses(asset).values()) == pytest.approx(16.0)
    drives = {(round(a.kp, 3), round(a.kd, 3), a.tau_limit) for a in asset.actuators}
    assert drives == {(40.0, 1.0, 30.0)}
    out = capsys.readouterr().out
    assert "foot of LF: LF_foot on LF_shank, radius 20 mm; left, mirrors RF; phase 0" in out
    assert "right, mirrors LH" in out and "fit-device" in out
    assert main(["robot", "show", str(asset.path)]) == 0
    shown = capsys.readouterr().out
    assert "note: the file has no keyframe" in shown and "--armature" in shown


def test_the_shipped_robot_is_read_back_with_its_motors(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Gains of Newton's motors, and of those next to MR devices, which are reported as left out."""
    own = load_robot()
    out = tmp_path / "again.usda"
    assert main(["robot", "import", str(own.path), "--out", str(out)]) == 0
    again = {a.joint: a for a in load_robot(robot=str(out)).actuators}
    for a in own.actuators:
        found = again[a.joint]
        assert (found.kp, found.kd, found.tau_limit) == pytest.approx((a.kp, a.kd, a.tau_limit))
    assert "MR devices were left out" in capsys.readouterr().out


def _like_isaac(stage: Usd.Stage) -> None:
    """PhysX's attributes, a motor of a kind that nobody knows here, and no articulation root."""
    stage.GetDefaultPrim().RemoveAppliedSchema("PhysicsArticulationRootAPI")
    for leg in PLACES:
        prim = stage.GetPrimAtPath(f"/dog/{leg}_thigh/{leg}_KFE")
        prim.CreateAttribute("physxJoint:armature", Sdf.ValueTypeNames.Float).Set(0.03)
        motor = stage.DefinePrim(f"/dog/{leg}_motor", "NewtonActuator")
        motor.CreateRelationship("newton:targets").SetTargets([prim.GetPath()])
        motor.CreateAttribute("newton:kp", Sdf.ValueTypeNames.Float).Set(55.0)


def test_usd_as_others_write_it(tmp_path: Path) -> None:
    """Rotor inertias of PhysX, and gains of a motor whose kind Newton would refuse."""
    asset = imported(usd(tmp_path, _like_isaac))
    knees = [a for a in asset.actuators if a.joint.endswith("KFE")]
    assert [a.kp for a in knees] == [55.0] * 4
    for a in knees:
        joint = asset.stage.GetPrimAtPath(f"/dog/joints/{a.joint}")
        assert joint.GetAttribute("newton:armature").Get() == pytest.approx(0.03)


def test_an_imported_robot_is_imported_again(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Stance, limits, gains, feet and gait are those that it has; its devices are left out and reported."""
    first = imported(urdf(tmp_path), "--pose", "*_KFE=-1.9", "*_HFE=0.95", "--kp", "*=33")
    assert main(["robot", "fit-device", str(first.path), "--joint", "*_KFE"]) == 0
    capsys.readouterr()
    again = tmp_path / "again.usda"
    assert main(["robot", "import", str(first.path), "--out", str(again)]) == 0
    assert "MR devices were left out" in capsys.readouterr().out
    second = load_robot(robot=str(again))
    assert second.layout == first.layout
    assert [(a.kp, a.kd, a.tau_limit) for a in second.actuators] == [(a.kp, a.kd, a.tau_limit) for a in first.actuators]
    assert masses(second) == pytest.approx(masses(first))


@pytest.mark.parametrize("names", ["左 Füß_{}"])
def test_names_of_any_language(tmp_path: Path, names: str) -> None:
    """They stay as they are but for what USD does not take; folders too."""
    asset = imported(urdf(tmp_path / "Füße und Pfoten", names=names))
    knee = names.format("LF").replace(" ", "_") + "_KFE"
    assert knee in asset.layout.joints
    assert main(["robot", "fit-device", str(asset.path), "--joint", knee]) == 0


@pytest.mark.parametrize("where", ["dogs/meshes", "elsewhere/dogs/meshes"])
def test_meshes_of_packages_are_found(tmp_path: Path, where: str) -> None:
    """Next to and around the file, or in a folder that is named."""
    (tmp_path / where).mkdir(parents=True)
    trimesh.creation.box((0.1, 0.2, 0.3)).export(tmp_path / where / "camera.stl")
    file = urdf(tmp_path / "dogs/urdf", camera("package://dogs/meshes/camera.stl"))
    options = ("--packages", str(tmp_path / "elsewhere")) if where.startswith("else") else ()
    asset = imported(file, *options)
    (mesh,) = (UsdGeom.Mesh(prim) for prim in asset.stage.Traverse() if prim.GetTypeName() == "Mesh")
    assert np.ptp(np.array(mesh.GetPointsAttr().Get()), axis=0) == pytest.approx([0.1, 0.2, 0.3])
    assert sum(masses(asset).values()) == pytest.approx(8.0 + 4 * 2.5 + 1.0)


def test_meshes_can_be_left_out(tmp_path: Path) -> None:
    """Masses stay."""
    asset = imported(urdf(tmp_path, camera("package://dogs/meshes/camera.stl")), "--skip-meshes")
    assert sum(masses(asset).values()) == pytest.approx(8.0 + 4 * 2.5 + 1.0)


def test_a_file_with_includes(robot, tmp_path: Path) -> None:  # noqa: ANN001
    """MJCF's includes are relative to the file that names them."""
    whole = robot().read_text()
    motors = whole[whole.index("<actuator>") : whole.index("</actuator>") + len("</actuator>")]
    (tmp_path / "parts").mkdir()
    (tmp_path / "parts/motors.xml").write_text(f"<mujoco>{motors}</mujoco>")
    file = tmp_path / "beast.xml"
    file.write_text(whole.replace(motors, '<include file="parts/motors.xml"/>'))
    assert {a.tau_limit for a in imported(file).actuators} == {30.0}


EXTRA = link("extra") + joint("spin", "trunk", "extra", kind="{kind}", limit="{limit}")

BAD_URDF = {
    "no robot": ("<svg><rect/></svg>", ("<svg>", "<robot>")),
    "no XML": ("hello", ("not XML", "line 1")),
    "cut off": ("<robot><link></robot>", ("not XML", "line 1")),
    "empty": ("", ("not XML",)),
    "no link": ("<robot/>", ("no <link>",)),
    "macros": (
        '<robot xmlns:xacro="http://www.ros.org/wiki/xacro"><xacro:leg/></robot>',
        ("xacro bad.urdf > robot.urdf",),
    ),
}


@pytest.mark.parametrize("what", BAD_URDF)
def test_what_is_no_urdf(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Said by what it is."""
    text, parts = BAD_URDF[what]
    (tmp_path / "bad.urdf").write_text(text)
    refused(tmp_path / "bad.urdf", parts, capsys)


BAD_DOGS: dict[str, tuple[dict, tuple[str, ...]]] = {
    "a missing mesh": ({"more": camera("meshes/camera.stl")}, ("link camera", "meshes/camera.stl", "--skip-meshes")),
    "a missing package": (
        {"more": camera("package://dogs/camera.stl")},
        ("link camera", "package://dogs/camera.stl", "--packages", "dogs", "--skip-meshes"),
    ),
    "a mesh on the network": ({"more": camera("http://127.0.0.1/camera.stl")}, ("network", "--skip-meshes")),
    "a mesh that is not read": ({"more": camera("dog.urdf")}, ("dog.urdf", ".stl", "convert")),
    "no mass": ({"shank": None}, ("LF_shank", "mass of 0 kg")),
    "mass 0": ({"shank": 0.0}, ("LF_shank", "mass of 0 kg")),
    "two trunks": ({"more": link("lone")}, ("trunk", "lone", "two trunks")),
    "a closed loop": ({"more": joint("tie", "LF_shank", "RF_shank")}, ("RF_KFE", "tie", "RF_shank", "loop")),
    "a joint that follows": (
        {"more": EXTRA.format(kind="revolute", limit=f'{LIMIT}<mimic joint="LF_KFE"/>')},
        ("<mimic>", "spin", "LF_KFE", "--fix spin"),
    ),
    "a link that is not there": ({"more": joint("tie", "trunk", "nowhere")}, ("tie", "child nowhere")),
    "a name twice": ({"more": link("LF_hip")}, ("two links", "LF_hip", "rename")),
    "no name": ({"more": link("")}, ("link number 14", "no name")),
    "limits turned round": ({"knee": "0.5"}, ("LF_KFE", "0.5", "-0.1", "swap")),
    "limits in words": ({"knee": "far"}, ("joint LF_KFE", '<limit lower="far">', "write a number")),
    "limits that are no numbers": ({"knee": "nan"}, ("joint LF_KFE", '<limit lower="nan">')),
    "limits in degrees": ({"knee": "-150"}, ("LF_KFE", "a range of ten turns", "radians", "--unlimited LF_KFE")),
    "no inertia": (
        {"more": EXTRA.format(kind="revolute", limit=LIMIT).replace('"0.01"', '"0"')},
        ("body extra of 1 kg", "the inertias 0, 0, 0 kg·m²", "three positive"),
    ),
    "a mass that is no number": ({"shank": math.nan}, ("link LF_shank", '<mass value="nan">', "write a number")),
    "macros left in a number": (
        {"more": EXTRA.format(kind="revolute", limit=LIMIT).replace('mass value="1.0"', 'mass value="${m}"')},
        ("link extra", '<mass value="${m}">', "xacro dog.urdf > robot.urdf"),
    ),
    "two numbers of three": (
        {"more": EXTRA.format(kind="revolute", limit=LIMIT).replace("0 0 0", "0 0")},
        ("joint spin", '<origin xyz="0 0">', "write 3 numbers"),
    ),
    "no axis": (
        {"more": EXTRA.format(kind="revolute", limit=LIMIT).replace("0 1 0", "0 0 0")},
        ("joint spin", "no axis"),
    ),
    "a type of other formats": ({"more": EXTRA.format(kind="hinge", limit=LIMIT)}, ("spin", "type hinge", "revolute")),
    "a planar joint": ({"more": EXTRA.format(kind="planar", limit=LIMIT)}, ("spin", "--fix spin", "weld")),
    "a joint that follows none": (
        {"more": EXTRA.format(kind="revolute", limit=f'{LIMIT}<mimic joint="LF"/>')},
        ("joint spin", "<mimic> of LF", "no joint"),
    ),
    "a circle next to the trunk": (
        {"more": link("a") + link("b") + joint("ab", "a", "b") + joint("ba", "b", "a")},
        ("link a", "after itself", "closed loop"),
    ),
    "a mesh without a name": ({"more": camera("")}, ("link camera", "without filename", "--skip-meshes")),
    "an inertia of no body": (
        {"more": EXTRA.format(kind="revolute", limit=LIMIT).replace('izz="0.01"', 'izz="0.03"')},
        ("body extra", "0.01, 0.01, 0.03", "none is larger"),
    ),
    "a slider": ({"more": EXTRA.format(kind="prismatic", limit=LIMIT)}, ("spin", "slide joint", "weld")),
}


@pytest.mark.parametrize("what", BAD_DOGS)
def test_bad_urdf_robots(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each names the place and what to write."""
    choices, parts = BAD_DOGS[what]
    refused(urdf(tmp_path, **choices), parts, capsys)


def test_joints_without_limits_turn_freely(tmp_path: Path) -> None:
    """Of a URDF's continuous joint, whose limits the format ignores, and of a USD joint; each is noted, unless said."""
    spins = urdf(tmp_path, EXTRA.format(kind="continuous", limit=LIMIT))
    drops = usd(tmp_path, lambda stage: _drop(stage, "/dog/trunk/LF_HAA", "physics:lowerLimit"))
    for path, name in ((spins, "spin"), (drops, "LF_HAA")):
        found = understand(read_robot(path), Choices())
        assert [joint.name for joint in found.robot.joints if joint.limits is None] == [name]
        assert any(f"no limits for {name}:" in note and "--unlimited" in note for note in found.notes)
        assert not any("no limits" in n for n in understand(read_robot(path), Choices(unlimited=(name,))).notes)


def test_a_gripper_is_held_where_it_is(tmp_path: Path) -> None:
    """Sliders and joints that follow are held, at the way that is said; their masses stay."""
    file = tmp_path / "arm.urdf"
    finger = joint("grip", "a", "b", kind="prismatic", at="0 0 0.3")
    text = link("world", mass=None) + link("a") + link("b") + joint("j", "world", "a", at="0 0 1")
    file.write_text(f"<robot>{text}{finger}</robot>")
    asset = imported(file, "--fix", "grip", "--pose", "grip=0.2")
    assert asset.layout.joints == ("j",)
    found = UsdPhysics.MassAPI(asset.stage.GetPrimAtPath("/arm/a"))
    assert found.GetMassAttr().Get() == pytest.approx(2.0)
    assert found.GetCenterOfMassAttr().Get() == pytest.approx((0.0, 0.1, 0.15))  # the slider moves along y


def test_no_feet(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """An arm that floats."""
    file = tmp_path / "arm.urdf"
    file.write_text(f"<robot>{link('a')}{link('b')}{joint('j', 'a', 'b', at='0 0 0.3')}</robot>")
    refused(file, ("a", "no legs", "--feet"), capsys)


def _twin(stage: Usd.Stage) -> None:
    prim = UsdGeom.Xform.Define(stage, "/dog/twin").GetPrim()
    UsdPhysics.RigidBodyAPI.Apply(prim)
    UsdPhysics.MassAPI.Apply(prim).CreateMassAttr(1.0)


def _tie(stage: Usd.Stage) -> None:
    made = UsdPhysics.RevoluteJoint.Define(stage, "/dog/tie")
    made.CreateBody0Rel().SetTargets(["/dog/LF_shank"])
    made.CreateBody1Rel().SetTargets(["/dog/RF_shank"])


def _drop(stage: Usd.Stage, prim: str, name: str) -> None:
    stage.GetPrimAtPath(prim).RemoveProperty(name)


def _two_motors(stage: Usd.Stage) -> None:
    for name in ("first", "second"):
        motor = stage.DefinePrim(f"/dog/{name}", "NewtonActuator")
        motor.CreateRelationship("newton:targets").SetTargets(["/dog/trunk/LF_HAA"])


BAD_USD: dict[str, tuple[Callable[[Usd.Stage], None], tuple[str, ...]]] = {
    "two trunks": (_twin, ("trunk", "twin", "two trunks")),
    "two motors": (_two_motors, ("joint LF_HAA has the actuators first and second", "write one")),
    "a closed loop": (_tie, ("joint tie", "LF_shank and RF_shank", "loop")),
    "centimetres": (lambda stage: UsdGeom.SetStageMetersPerUnit(stage, 0.01), ("metersPerUnit is 0.01", "metres")),
    "y up": (lambda stage: UsdGeom.SetStageUpAxis(stage, "Y"), ("upAxis is Y", "Z up")),
    "no torque limit": (
        lambda stage: _drop(stage, "/dog/trunk/LF_HAA", "drive:angular:physics:maxForce"),
        ("LF_HAA", "--torque-limit"),
    ),
    "a reference that is missing": (
        lambda stage: stage.GetPrimAtPath("/dog/trunk").GetReferences().AddReference("hull.usda"),
        ("hull.usda",),
    ),
    "a layer that is missing": (
        lambda stage: stage.GetRootLayer().subLayerPaths.append("parts/hull.usda"),
        ("parts/hull.usda@ is missing", "put it"),
    ),
    "a layer that is missing elsewhere": (
        lambda stage: stage.GetRootLayer().subLayerPaths.append("../configuration/hull.usd"),
        ("configuration/hull.usd@ is missing", "put it into the asset's folder"),
    ),
    "a payload that is missing elsewhere": (
        lambda stage: stage.GetPrimAtPath("/dog/trunk").GetPayloads().AddPayload("../hull.usd"),
        ("../hull.usd@ is missing", "put it into the asset's folder"),
    ),
    "mass 0": (
        lambda stage: stage.GetPrimAtPath("/dog/LF_hip").GetAttribute("physics:mass").Set(0.0),
        ("LF_hip", "mass of 0 kg"),
    ),
    "a mass that is no number": (
        lambda stage: stage.GetPrimAtPath("/dog/LF_hip").GetAttribute("physics:mass").Set(math.nan),
        ("/dog/LF_hip", "physics:mass is no number"),
    ),
    "a place that is no number": (
        lambda stage: (
            stage.GetPrimAtPath("/dog/trunk/LF_HAA").GetAttribute("physics:localPos0").Set(Gf.Vec3f(math.nan, 0, 0))
        ),
        ("/dog/trunk/LF_HAA", "physics:localPos0 is no number"),
    ),
    "no physics": (lambda stage: Sdf.Layer.Clear(stage.GetRootLayer()), ("defaultPrim",)),
}


@pytest.mark.parametrize("what", BAD_USD)
def test_bad_usd_robots(what: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Each names the place and what to write."""
    change, parts = BAD_USD[what]
    refused(usd(tmp_path, change), parts, capsys)


PLANAR = (
    '<mujoco><worldbody><body name="cart"><joint name="x" type="slide"/><joint name="turn"/>'
    '<geom size="0.1" mass="1"/></body></worldbody></mujoco>'
)


def test_a_missing_include_and_what_is_no_mjcf(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """MuJoCo names the line, and writes no log of its own."""
    monkeypatch.chdir(tmp_path)
    for text, parts in (
        ('<mujoco><include file="legs.xml"/></mujoco>', ("legs.xml", "include", "put it there")),
        ("<sdf/>", ("sdf",)),
        ("hello", ("line number=1",)),
        ("<mujoco/>", ("no body",)),
        (PLANAR, ("cart has 2 joints, x, turn", "<freejoint/>")),
        (PLANAR.replace('mass="1"', 'mass="nan"'), ("line 1", "NaN", "write a number")),
    ):
        (tmp_path / "bad.xml").write_text(text)
        refused(tmp_path / "bad.xml", parts, capsys)


def refused(file: Path, parts: tuple[str, ...], capsys: pytest.CaptureFixture[str]) -> None:
    """Exit code 2, one line with the file and the parts, nothing written."""
    before = sorted(file.parent.iterdir())
    assert main(["robot", "import", str(file), "--out", str(file.with_name("out.usda"))]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and str(file) in error
    assert all(part.lower() in error.lower() for part in parts), error
    assert sorted(file.parent.iterdir()) == before


@pytest.mark.parametrize("kind", ["hinge", "slide"])
def test_the_matrix_of_a_joint_is_its_place(kind: str) -> None:
    """At any angle or way, about any axis, between frames that are turned and moved."""
    rng = np.random.default_rng(0)
    frames = [RigidTransform.from_components(rng.normal(size=3), Rotation.random(rng=rng)) for _ in range(2)]
    axis = rng.normal(size=3)
    own = Joint(
        name="a",
        kind=kind,
        parent=0,
        child=1,
        in_parent=frames[0],
        in_child=frames[1],
        axis=axis / np.linalg.norm(axis),
        limits=None,
        armature=0.0,
    )
    for q in rng.uniform(-4.0, 4.0, 20):
        np.testing.assert_allclose(own.matrix(q), own.place(q).as_matrix(), atol=1e-12)
