"""Of a described scene the robot of a log: names, trunk, floor, held joints, motors."""

from pathlib import Path

import mujoco
import pytest

from mrwarp.robot_logs.described.logged_part import floor_height, hold, let_float, name_all
from mrwarp.robot_logs.robot_log import LogError


@pytest.mark.parametrize(
    ("drives", "held"),
    [
        ('<motor joint="elbow"/><position joint="grip"/>', ("grip",)),  # the spring has no drive
        ('<motor joint="elbow"/>', ()),
        ("", ("spring", "grip")),  # as of a URDF, which names none
    ],
)
def test_a_joint_that_the_log_lacks_is_held_by_its_drive(drives: str, held: tuple[str, ...]) -> None:
    """Left to itself a gripper would swing in the replay, and its arm be blamed; passive joints do move."""
    names, end = ("elbow", "spring", "grip"), "</body>" * 3
    links = "".join(f'<body><joint name="{x}"/><geom size="0.1" mass="1"/>' for x in names)
    spec = mujoco.MjSpec.from_string(
        f"<mujoco><worldbody>{links}{end}</worldbody><actuator>{drives}</actuator></mujoco>"
    )
    assert hold(spec, ["elbow"], ()) == held
    for drive in spec.actuators:
        spec.delete(drive)
    assert spec.compile().nv == len(names) - len(held)


FINGER = '<body pos="0 {y} 0"><joint name="{name}" type="slide" axis="0 1 0"/><geom size="0.01" mass="0.1"/></body>'
HAND = "".join(FINGER.format(y=y, name=name) for y, name in ((0.05, "left"), (-0.05, "right")))
ARM = f'<worldbody><body><joint name="elbow"/><geom size="0.1" mass="1"/>{HAND}</body></worldbody>'
GRIP = '<fixed name="grip"><joint joint="left" coef="1"/><joint joint="right" coef="1"/></fixed>'


@pytest.mark.parametrize(
    ("more", "logged", "held"),
    [
        ('<equality><joint joint1="right" joint2="left"/></equality>', ["elbow"], ("left", "right")),
        (f'<tendon>{GRIP}</tendon><actuator><position tendon="grip"/></actuator>', ["elbow"], ("left", "right")),
        ('<equality><joint joint1="right" joint2="left"/></equality>', ["elbow", "left"], ()),
        ('<equality><joint joint1="elbow" joint2="left"/></equality>', ["elbow"], ("right",)),
        (f'<tendon>{GRIP}</tendon><actuator><motor joint="elbow"/></actuator>', ["elbow"], ()),
    ],
)
def test_a_gripper_that_the_log_lacks_is_held_with_what_ties_it(
    more: str, logged: list[str], held: tuple[str, ...]
) -> None:
    """Fingers that follow one another hung loose in the replay; what follows a logged joint does move."""
    spec = mujoco.MjSpec.from_string(f"<mujoco>{ARM}{more}</mujoco>")
    assert hold(spec, logged, ()) == held
    for drive in spec.actuators:
        spec.delete(drive)
    model = spec.compile()
    assert model.nv == 3 - len(held) and bool(model.neq + model.ntendon) == (not {"left", "right"} <= set(held))


BALL = '<body name="ball" pos="3 0 1"><freejoint/><geom size="0.1"/></body>'
DOG = '<body name="dog" pos="0 0 2">{}<geom size="0.1"/><body><joint name="hip"/><geom size="0.05"/></body></body>'
FLOORS = {
    "plane": ('<geom type="plane" size="1 1 1" pos="0 0 -0.4"/>', -0.4),
    "picture": ('<geom type="plane" size="1 1 1" contype="0" conaffinity="0"/>', None),
    "table": ('<body name="table"><geom type="box" size="1 1 0.1" pos="0 0 0.5" rgba="1 1 1 0"/></body>', 0.6),
}


@pytest.mark.parametrize("floor", FLOORS)
def test_a_robot_floats_above_its_scene(floor: str) -> None:
    """The first body, and the first free joint, may be a table's or a ball's; a floor may be anywhere, and drawn."""
    scene, height = FLOORS[floor]
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{scene}{BALL}{DOG.format('')}</worldbody></mujoco>")
    name_all(spec)
    let_float(Path("robot.xml"), spec, ["hip"])
    model = spec.compile()
    assert [model.joint(j).name for j in range(model.njnt)][1:] == ["hip"] and not model.jnt_type[0]
    assert model.body(int(model.jnt_bodyid[0])).name == "dog" and all(body.name for body in spec.bodies)
    assert floor_height(model) == (None if height is None else pytest.approx(height))


def test_a_trunk_on_rails_does_not_float() -> None:
    """MuJoCo would refuse a free joint next to them, without the reason."""
    rail = '<joint name="rail" type="slide" axis="0 0 1"/>'
    spec = mujoco.MjSpec.from_string(f"<mujoco><worldbody>{DOG.format(rail)}</worldbody></mujoco>")
    with pytest.raises(LogError, match="rail ties dog to the world"):
        let_float(Path("robot.xml"), spec, ["hip"])
