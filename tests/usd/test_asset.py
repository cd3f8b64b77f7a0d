"""The USD assets: masses, order and limits as Newton and MuJoCo see them; refusals; round trips; the schema."""

import math
import sys
from dataclasses import replace
from pathlib import Path

import mujoco
import newton
import numpy as np
import pytest
from pxr import Sdf, Usd

from mrwarp.bench.virtual_bench import bench_device
from mrwarp.params import MrParams
from mrwarp.usd.asset import check_currents, load_bench, load_robot
from mrwarp.usd.edit import edit_asset
from mrwarp.usd.open_stage import ASSETS, SCHEMA, AssetError
from mrwarp.usd.record import PREFIX
from mrwarp.usd.robot import CALVES, DEFAULT_Q, JOINTS, LEGS, STAND_HEIGHT
from tests.messages import has_parts

LIMITS = {"hip": (-0.863, 0.863), "thigh": (-0.686, 4.501), "calf": (-2.818, -0.888)}  # [rad] unitree_go1, Menagerie
ROTOR, GEAR = 0.000111842, {"hip": 6.0, "thigh": 6.0, "calf": 9.0}  # [kg·m2], [1] Unitree Go1 motor, mjlab
MASS = {("go1", 0): 12.0, ("mr_go", 0): 12.6, ("go1", 3): 15.0, ("mr_go", 3): 15.6}  # [kg] paper section 6.4
FL_CALF = "/mr_go/actuators/FL_calf"
K1 = "double newton:mr:K1 = 10.413315"


def to_mujoco(stage: Usd.Stage) -> mujoco.MjModel:
    """Convert a stage as the simulator does, without its actuators."""
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_usd(stage, ignore_paths=[".*/actuators/.*"])
    return newton.solvers.SolverMuJoCo(builder.finalize(device="cpu")).mj_model


@pytest.fixture(scope="module")
def models() -> dict[tuple[str, int], mujoco.MjModel]:
    """MuJoCo models of all four variants."""
    return {key: to_mujoco(load_robot(robot=key[0], payload=key[1]).stage) for key in MASS}


@pytest.fixture(scope="module")
def model(models: dict[tuple[str, int], mujoco.MjModel]) -> mujoco.MjModel:
    """MuJoCo model of the default variant."""
    return models["mr_go", 0]


def body(model: mujoco.MjModel, name: str) -> int:
    """Index of a body by its USD name."""
    return model.body(f"_mr_go_{name}").id


def inertia(model: mujoco.MjModel, index: int) -> np.ndarray:
    """Inertia matrix of a body about its centre of mass, in the body's axes [kg·m2]."""
    axes = np.zeros(9)
    mujoco.mju_quat2Mat(axes, model.body_iquat[index])
    rotation = axes.reshape(3, 3)
    return rotation @ np.diag(model.body_inertia[index]) @ rotation.T


def edited(folder: Path, *changes: tuple[str, str]) -> Path:
    """A copy of the robot file with text replaced; each text must occur."""
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path = folder / "edited.usda"
    path.write_text(text, encoding="utf-8")
    return path


@pytest.mark.parametrize("variant", MASS)
def test_asset_total_mass(models, variant):
    """The variants weigh what the paper's table says, to float32 rounding."""
    assert models[variant].body_mass.sum() == pytest.approx(MASS[variant], abs=1e-5)


def test_asset_joint_order(models):
    """The free joint comes first, then the joints of robot.JOINTS, one degree of freedom each, in every variant."""
    for model in models.values():
        names = [model.joint(i).name for i in range(1, model.njnt)]
        assert names == [f"_mr_go_joints_{joint}" for joint in JOINTS]
        assert model.jnt_type[0] == mujoco.mjtJoint.mjJNT_FREE
        assert model.jnt_dofadr[1:].tolist() == list(range(6, 18))
        assert model.jnt_qposadr[1:].tolist() == list(range(7, 19))


def test_asset_limits_and_armature(model):
    """Joint ranges and reflected rotor inertias are the source numbers; friction and damping are zero."""
    expected = np.array([LIMITS[joint.split("_")[1]] for joint in JOINTS])
    armature = np.array([ROTOR * GEAR[joint.split("_")[1]] ** 2 for joint in JOINTS])
    # degrees in the file, their factor, the product and Newton's radians: half a float32 rounding each
    np.testing.assert_allclose(model.jnt_range[1:], expected, rtol=2.0 * float(np.finfo(np.float32).eps))
    np.testing.assert_allclose(model.dof_armature[6:], armature, rtol=1e-6)
    assert not model.dof_damping.any()
    assert not model.dof_frictionloss.any()


def test_asset_axes(model):
    """Hips turn about x, thighs and calves about y, all in the positive sense."""
    expected = [(1, 0, 0) if joint.endswith("hip") else (0, 1, 0) for joint in JOINTS]
    np.testing.assert_allclose(model.jnt_axis[1:], expected, atol=1e-6)


def test_asset_constraint_stiffness(model):
    """Calf friction is stiff enough to hold (creep), and joint limits are critically damped."""
    calf = [6 + JOINTS.index(joint) for joint in CALVES]
    np.testing.assert_allclose(model.dof_solref[calf], [(0.01, 1.0)] * 4, rtol=1e-6)
    np.testing.assert_allclose(model.dof_solimp[calf, :2], 0.9999, rtol=1e-6)
    np.testing.assert_allclose(model.jnt_solref[1:], [(0.02, 1.0)] * 12, rtol=1e-6)


def test_asset_stance_height(model):
    """In the default pose the soles touch z = 0, within 1 mm, when the trunk is at STAND_HEIGHT."""
    data = mujoco.MjData(model)
    data.qpos[:3] = 0.0, 0.0, STAND_HEIGHT
    data.qpos[7:] = DEFAULT_Q
    mujoco.mj_forward(model, data)
    feet = [i for i in range(model.ngeom) if "_foot" in model.geom(i).name]
    assert [model.geom(i).name.split("/")[-1][:2] for i in feet] == list(LEGS)
    soles = data.geom_xpos[feet, 2] - model.geom_size[feet, 0]
    np.testing.assert_allclose(soles, 0.0, atol=1e-3)


def test_asset_foot_friction(model):
    """Feet are spheres of 23 mm with friction 0.8 that wins over the ground's."""
    feet = [i for i in range(model.ngeom) if "_foot" in model.geom(i).name]
    np.testing.assert_allclose(model.geom_size[feet, 0], 0.023, rtol=1e-6)
    np.testing.assert_allclose(model.geom_friction[feet, 0], 0.8, rtol=1e-6)
    assert (model.geom_priority[feet] == 1).all()
    assert (model.geom_gap == 0).all()


def test_asset_no_self_collision(model):
    """On the ground in the default pose only the four feet make contact; every pair of bodies is excluded."""
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_ground_plane(cfg=newton.ModelBuilder.ShapeConfig(gap=0.0))
    builder.add_usd(load_robot().stage, ignore_paths=[".*/actuators/.*"])
    grounded = newton.solvers.SolverMuJoCo(builder.finalize(device="cpu")).mj_model
    data = mujoco.MjData(grounded)
    data.qpos[2] = STAND_HEIGHT
    data.qpos[7:] = DEFAULT_Q
    mujoco.mj_forward(grounded, data)
    assert data.ncon == 4
    assert model.nexclude == 13 * 12 // 2


@pytest.mark.parametrize("variant", MASS)
def test_asset_left_right_symmetry(models, variant):
    """Mirrored hips and thighs have mirrored centres and inertias; the robot's centre is near the middle plane."""
    model, mirror = models[variant], np.diag([1.0, -1.0, 1.0])
    for left, right in (("FL", "FR"), ("RL", "RR")):
        for segment in ("hip", "thigh"):
            a, b = body(model, f"{left}_{segment}"), body(model, f"{right}_{segment}")
            assert model.body_mass[a] == model.body_mass[b]
            np.testing.assert_allclose(model.body_ipos[a], mirror @ model.body_ipos[b], atol=1e-8)
            np.testing.assert_allclose(inertia(model, a), mirror @ inertia(model, b) @ mirror, atol=2e-8)
    data = mujoco.MjData(model)
    data.qpos[7:] = DEFAULT_Q
    mujoco.mj_forward(model, data)
    assert abs(data.subtree_com[1][1]) < 2e-3


def test_asset_device_mass_by_parallel_axes(models):
    """Go1 thigh + 0.14 kg cylinder (radius 0.03, length 0.03 m) at the knee gives the MR_Go thigh's mass properties."""
    go1, mr_go = models["go1", 0], models["mr_go", 0]
    device = 0.14 * np.diag([(3 * 0.03**2 + 0.03**2) / 12, 0.03**2 / 2, (3 * 0.03**2 + 0.03**2) / 12])
    for leg in LEGS:
        i = body(go1, f"{leg}_thigh")
        parts = [(go1.body_mass[i], go1.body_ipos[i], inertia(go1, i)), (0.14, np.array([0, 0, -0.213]), device)]
        mass = sum(part[0] for part in parts)
        centre = sum(part[0] * part[1] for part in parts) / mass
        total = np.zeros((3, 3))
        for m, c, own in parts:
            d = c - centre
            total += own + m * (d @ d * np.eye(3) - np.outer(d, d))
        assert mr_go.body_mass[i] == pytest.approx(mass, rel=1e-6)
        np.testing.assert_allclose(mr_go.body_ipos[i], centre, atol=1e-8)
        np.testing.assert_allclose(inertia(mr_go, i), total, atol=2e-8)


def test_any_payload_can_be_carried():
    """Half of the variant's mass has half of its inertia; the robot is otherwise the same."""
    half, whole = (to_mujoco(load_robot(payload=payload).stage) for payload in (1.5, 3))
    index = body(half, "payload")
    assert half.body_mass[index] == pytest.approx(1.5, rel=1e-6)
    np.testing.assert_allclose(half.body_inertia[index], 0.5 * whole.body_inertia[index], rtol=1e-5)
    np.testing.assert_array_equal(np.delete(half.body_mass, index), np.delete(whole.body_mass, index))


def test_asset_payload_is_rigid(models):
    """The payload is a 3 kg body without joint on the trunk's back; it adds no degree of freedom."""
    loaded = models["mr_go", 3]
    index = body(loaded, "payload")
    assert loaded.body_mass[index] == 3.0
    assert loaded.body_jntnum[index] == 0
    assert loaded.body_parentid[index] == body(loaded, "trunk")
    np.testing.assert_allclose(loaded.body_pos[index], (0.0, 0.0, 0.108), atol=1e-7)
    assert loaded.nv == models["mr_go", 0].nv == 18


def test_load_robot_actuators():
    """Actuators come in joint order; calves of mr_go carry the paper's device, go1 has motors only."""
    for robot in ("go1", "mr_go"):
        asset = load_robot(robot=robot)
        assert tuple(actuator.joint for actuator in asset.actuators) == JOINTS
        for actuator in asset.actuators:
            calf = actuator.joint in CALVES
            assert (actuator.kp, actuator.kd, actuator.tau_limit) == (35.0, 0.6, 35.55 if calf else 23.7)
            assert actuator.mr == (MrParams() if calf and robot == "mr_go" else None)


def test_load_bench():
    """The bench has one free-turning joint of 0.01 kg·m2 with the paper's device and no motor."""
    asset = load_bench()
    params = asset.actuators[0].mr
    assert params == bench_device() == MrParams().replace(q_neutral=0.0, kp_base=0.0, kp_low=0.0, kd=0.0, tau_limit=1e4)
    model = to_mujoco(asset.stage)
    assert model.nv == 1
    assert not model.jnt_limited[0]
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    assert model.dof_M0[0] == pytest.approx(0.01, rel=1e-6)
    assert data.qfrc_bias[0] == 0.0


def test_load_robot_leaves_file_alone():
    """Variant choice and edits live in the session layer: the file and later loads do not see them."""
    before = (ASSETS / "mr_go.usda").read_bytes()
    asset = load_robot(payload=3)
    assert asset.stage.GetPrimAtPath(FL_CALF).GetAttribute(f"{PREFIX}K1").Set(3.0)
    assert not asset.stage.GetRootLayer().dirty
    assert load_robot().actuators[2].mr == MrParams()
    assert (ASSETS / "mr_go.usda").read_bytes() == before


JOINT = 'def PhysicsRevoluteJoint "RL_thigh" (\n            prepend inherits = </mr_go/%s>'
VARIANTS = 'prepend variantSets = ["robot", "payload"]'
OUTSIDE = "outside the asset's folder"
MOTOR = "/mr_go/actuators/FL_hip"
CALF = "/mr_go/actuators/RR_calf"

REFUSED: dict[str, tuple[tuple[str, str] | bytes, str]] = {
    "missing": ((K1, ""), f"{FL_CALF} .. newton:mr:K1 is missing .. 0 to 1e+15 .. 10.4133"),
    "blocked": ((K1, K1.replace("10.413315", "None")), f"{FL_CALF} .. newton:mr:K1 is missing .. 0 to 1e+15"),
    "misspelt": ((K1, K1 + "\ndouble newton:mr:alfa = 1"), f"{FL_CALF} .. 'newton:mr:alfa' .. 'alpha' .. 0 to 1e"),
    "negative": ((K1, K1.replace("10", "-10")), f"{FL_CALF} .. newton:mr:K1 = -10.4133 .. 0 to 1e+15"),
    "nan": ((K1, K1.replace("10.413315", "nan")), f"{FL_CALF} .. newton:mr:K1 = nan .. 0 to 1e+15"),
    "infinite": ((K1, K1.replace("10.413315", "inf")), f"{FL_CALF} .. newton:mr:K1 = inf .. 0 to 1e+15"),
    "too large": ((K1, K1.replace("10.4", "2e15 #")), f"{FL_CALF} .. newton:mr:K1 = 2e+15 .. 0 to 1e+15"),
    "text": ((K1, 'string newton:mr:K1 = "ten"'), f"{FL_CALF} .. newton:mr:K1 = 'ten' .. not a number .. 0 to 1e"),
    "a path": ((K1, "double newton:mr:K1 = </x>"), f"{FL_CALF} .. newton:mr:K1 .. is not a number"),
    "animated": ((K1, "double newton:mr:K1.timeSamples = {0: 1}"), f"{FL_CALF} .. varies with time .. 0 to 1e+15"),
    "unbounded": (("gamma = -10.53036", "gamma = -20"), f"{FL_CALF} .. beta + gamma > 0 .. raise beta or gamma"),
    "negative kp": (("float newton:kp = 35", "float newton:kp = -1"), f"{MOTOR} .. newton:kp = -1 .. 0 to 10000"),
    "no kd": (("float newton:kd = 0.6", ""), f"{MOTOR} .. newton:kd is missing .. 0 to 1000"),
    "a nan limit": (("newton:maxEffort = 23.7", "newton:maxEffort = nan"), f"{MOTOR} .. = nan .. 0 to 10000"),
    "no schema": (
        ('"NewtonPDControlAPI", ', ""),
        f"{MOTOR} .. apiSchemas .. allowed: MrwarpMRDriveAPI, or NewtonPDControlAPI",
    ),
    "no actuator": (
        ('NewtonActuator "RR_calf"', 'Scope "RR_calf"'),
        "/mr_go/actuators .. no NewtonActuator drives joint RR_calf",
    ),
    "two of one joint": (
        ("targets = </mr_go/joints/RR_calf>", "targets = </mr_go/joints/FL_hip>"),
        f"/mr_go/joints/FL_hip is driven by {CALF} already; remove one",
    ),
    "no joint's": (
        ("targets = </mr_go/joints/RR_calf>", "targets = </mr_go/trunk>"),
        f"{CALF} .. not one joint .. allowed:",
    ),
    "no such joint": (
        ('PhysicsRevoluteJoint "RL_thigh"', 'PhysicsRevoluteJoint "RL_tigh"'),
        "/mr_go/joints/RL_thigh: revolute joint is missing",
    ),
    "its own parent": (  # USD's own message has several lines
        (JOINT % "parts/ThighJoint", JOINT % "joints/RL_thigh"),
        "composition error: Cycle detected .. ; repair the reference",
    ),
    "no payloads": (
        ('variantSet "payload" = {', 'variantSet "payloads" = {'),
        "/mr_go: variant set 'payload' is empty; write",
    ),
    "a reference": ((VARIANTS, f"{VARIANTS}\nprepend references = @../outside.usda@"), OUTSIDE),
    "a payload": ((VARIANTS, f"{VARIANTS}\nprepend payload = @https://example.com/robot.usda@"), OUTSIDE),
    "a clip": (
        (VARIANTS, f"{VARIANTS}\nclips = {{dictionary default = {{asset manifestAssetPath = @../outside.usda@}}}}"),
        OUTSIDE,
    ),
    "a network one file away": (
        ('    defaultPrim = "mr_go"', '    defaultPrim = "mr_go"\n    subLayers = [@./below.usda@]'),
        "below.usda: @/etc/net.onnx@",
    ),
    "no USD": (b"hello", "not readable as USD"),
    "no default prim": (b"#usda 1.0\n", "defaultPrim"),
    "not UTF-8": (  # USD's own message quotes the bytes, which Python cannot decode
        b"#usda 1.0\n(\n    defaultPrim = \xff\xfe\n)\n",
        "not readable as USD: the text is not UTF-8; repair the file there",
    ),
}
"""Faults of a robot's file, and prim, attribute, value and remedy in the message."""


@pytest.mark.parametrize("what", REFUSED)
def test_a_bad_robot_file_is_refused(tmp_path: Path, what: str) -> None:
    """In one line with the file."""
    made, said = REFUSED[what]
    folder = tmp_path / "inner"
    folder.mkdir()
    (tmp_path / "outside.usda").write_text('#usda 1.0\n(defaultPrim = "x")\ndef "x" {}\n', encoding="utf-8")
    below = '#usda 1.0\nover "mr_go"\n{\n    asset newton:modelPath = @/etc/net.onnx@\n}\n'
    (folder / "below.usda").write_text(below, encoding="utf-8")
    path = folder / "edited.usda"
    if isinstance(made, bytes):
        path.write_bytes(made)
    else:
        edited(folder, made)
    with pytest.raises(AssetError) as refused:
        load_robot(path)
    message = str(refused.value)
    assert has_parts(message, said) and str(folder) in message and "\n" not in message, message


def test_refusals_of_long_names_stay_readable(tmp_path):
    """A schema's name of 100,000 letters leaves place and remedy in the message."""
    long = tmp_path / "long.usda"
    long.write_text((ASSETS / "mr_go.usda").read_text().replace('"NewtonPDControlAPI"', f'"{100_000 * "x"}"'))
    with pytest.raises(AssetError, match="apiSchemas = .* allowed: ") as refused:
        load_robot(long, robot="go1")
    assert len(str(refused.value)) <= 1500 and str(long) in str(refused.value)


def test_one_edit_changes_four_or_one(tmp_path):
    """A number changed in MRDevice reaches all calves; a line in one leg's variant block only that leg."""
    asset = load_robot(edited(tmp_path, (K1, "float newton:mr:K1 = 12.3")))
    assert [a.mr.bouc_wen.K1 for a in asset.actuators if a.mr] == [12.3] * 4
    lines = (ASSETS / "mr_go.usda").read_text(encoding="utf-8").splitlines()
    mr_variant = lines.index('        "mr_go" {')
    leg = next(i for i, line in enumerate(lines) if i > mr_variant and 'over "RL_calf"' in line)
    lines.insert(lines.index("                {", leg) + 1, "double newton:mr:K1 = 12.3")
    (tmp_path / "one.usda").write_text("\n".join(lines), encoding="utf-8")
    asset = load_robot(tmp_path / "one.usda")
    assert [a.mr.bouc_wen.K1 for a in asset.actuators if a.mr] == [10.413315, 10.413315, 12.3, 10.413315]


def test_parameters_round_trip(tmp_path):
    """Parameters survive file and reload bit for bit; the saved file keeps variants and the other legs."""
    rng = np.random.default_rng(7)
    values = {spec.name: float(rng.uniform(max(spec.low, -1e3), min(spec.high, 1e3))) for spec in MrParams.specs()}
    params = MrParams.from_dict({**values, "beta": 1 / 3, "gamma": math.pi})
    edit_asset(ASSETS / "mr_go.usda", "FL_calf", params.to_dict(), tmp_path / "saved.usda")
    again = load_robot(tmp_path / "saved.usda", payload=3)
    assert again.actuators[2].mr == params
    assert again.actuators[5].mr == MrParams()
    assert load_robot(tmp_path / "saved.usda", robot="go1").actuators[2].mr is None


def test_schema_agrees_with_parameters():
    """The registered schema has exactly the attributes of MrParams, as doubles, with default, unit and range."""
    definition = Usd.SchemaRegistry().FindAppliedAPIPrimDefinition(SCHEMA)
    assert {str(n) for n in definition.GetPropertyNames()} == {PREFIX + spec.name for spec in MrParams.specs()}
    for spec in MrParams.specs():
        attribute = definition.GetAttributeDefinition(PREFIX + spec.name)
        assert attribute.GetTypeName() == Sdf.ValueTypeNames.Double
        assert attribute.GetFallbackValue() == spec.default
        assert attribute.GetMetadata("limits")["hard"] == {"minimum": spec.low, "maximum": spec.high}
        for word in (spec.doc, f"Unit: {spec.unit}", f"Source: {spec.source}"):
            assert word in attribute.GetDocumentation()


def test_schema_file_is_current(monkeypatch):
    """generatedSchema.usda is what write_schema.py writes from the parameters of today."""
    monkeypatch.syspath_prepend(str(ASSETS / "schema"))
    import write_schema  # type: ignore[import-not-found]

    monkeypatch.delitem(sys.modules, "write_schema")
    assert write_schema.TARGET.read_text(encoding="utf-8") == write_schema.schema_text()


def test_newton_parser_sees_inherited_parameters():
    """The attributes that Newton's actuator parser looks for are visible through the inherits arc."""
    asset = load_robot()
    prim = asset.stage.GetPrimAtPath(FL_CALF)
    authored = {p.GetName() for p in prim.GetAuthoredPropertiesInNamespace("newton")}
    assert authored == {"newton:targets"} | {PREFIX + spec.name for spec in MrParams.specs()}
    assert prim.HasAPI(SCHEMA)


def test_a_broken_wire_takes_none_of_the_currents(tmp_path):
    """One coil of 0 A next to whole ones is simulated with any current; coils that all take less refuse it."""

    def legs(**most: float):
        robot = load_robot().actuators
        return [replace(a, mr=a.mr.replace(current_max=most.get(a.joint, 1.5))) if a.mr else a for a in robot]

    check_currents(legs(RR_calf=0.0), [0.0, 1.5])
    with pytest.raises(AssetError, match="RR_calf takes 0 to 0.5 A"):
        check_currents(legs(RR_calf=0.5), [0.0, 1.5])
    dead = {joint: 0.0 for joint in ("FL_calf", "FR_calf", "RL_calf", "RR_calf")}
    check_currents(legs(**dead), [0.0])
    with pytest.raises(AssetError, match="takes 0 to 0 A"):
        check_currents(legs(**dead), [0.5])
