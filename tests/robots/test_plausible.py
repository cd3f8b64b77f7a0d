"""Placeholders that no machine can have: inertias, torque limits and guessed rotors."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from tests.robots.test_foreign_files import joint, link, urdf
from tests.robots.test_strange_robots import DOG


@pytest.mark.parametrize("value", [100.0, 1.0])
def test_inertias_of_much_larger_bodies_are_replaced(tmp_path: Path, value: float) -> None:
    """By a solid box of the shapes and joints; the note names a body and both numbers."""
    path = urdf(tmp_path)
    good = '<mass value="0.5"/><inertia ixx="0.01" iyy="0.01" izz="0.01"'
    path.write_text(path.read_text().replace(good, good.replace("0.01", str(value))))
    found = understand(read_robot(path), Choices())
    shank = next(body for body in found.robot.bodies if body.name == "LF_shank")
    sides = np.array([0.04, 0.04, 0.22])  # a ball of 20 mm, 0.2 m below the joint
    sides = np.maximum(sides, 0.0005 ** (1 / 3))
    np.testing.assert_allclose(np.diag(shank.inertia), 0.5 / 12.0 * ((sides**2).sum() - sides**2), rtol=1e-6)
    note = next(note for note in found.notes if "no body's of that size" in note)
    assert "LF_shank, RF_shank, LH_shank and others" in note and f"{value:g} kg·m² at 0.5 kg" in note
    assert [body.inertia[0, 0] for body in found.robot.bodies if body.name.endswith("thigh")] == [
        pytest.approx(0.01)
    ] * 4


def test_torque_limits_of_no_motor_are_refused(file: Callable[..., Path]) -> None:
    """By what the stance needs; the user's own are taken, with a note; ten times what it needs is a motor's."""
    path = file(DOG, limit=2000.0)
    with pytest.raises(RobotFileError) as error:
        understand(read_robot(path), Choices())
    for part in ("2000 N·m", "placeholder", "FL_roll", "--torque-limit", "'*=NM'"):
        assert part in str(error.value)
    needed = float(str(error.value).split("to hold the robot, ")[1].split()[0])
    assert 4.0 < needed < 7.0  # 14.4 kg on four knees bent by half a radian
    own = understand(read_robot(path), Choices(torque_limit={"*": 2000.0}))
    assert any("--torque-limit said so" in note for note in own.notes)
    assert understand(read_robot(file(DOG, limit=60.0)), Choices()).drives["FR_knee"].torque_limit == 60.0


def test_one_placeholder_among_motors_is_named(file: Callable[..., Path]) -> None:
    """It alone is to be given."""
    path = file(DOG)
    path.write_text(
        path.read_text().replace(
            'joint="FL_roll" kp="40.0" forcerange="-30.0 30.0"', 'joint="FL_roll" kp="40.0" forcerange="-999 999"'
        )
    )
    with pytest.raises(RobotFileError, match="torque limit of FL_roll = 999 N·m .*--torque-limit 'FL_roll=NM'$"):
        understand(read_robot(path), Choices())


def test_torque_limits_of_an_arm_are_those_of_its_weight(tmp_path: Path) -> None:
    """Two links of 1 kg: a few newton metres."""
    limit = '<limit lower="-1" upper="1" effort="{}" velocity="5"/>'
    for effort, fits in (("1000", False), ("30", True)):
        text = link("world", mass=None) + link("a") + link("b")
        text += joint("j1", "world", "a", limit=limit.format(effort))
        text += joint("j2", "a", "b", at="0 0 0.3", limit=limit.format(effort))
        path = tmp_path / "arm.urdf"
        path.write_text(f"<robot>{text}</robot>")
        if fits:
            assert understand(read_robot(path), Choices()).drives["j1"].torque_limit == 30.0
        else:
            with pytest.raises(RobotFileError, match="1000 N·m is .* times"):
                understand(read_robot(path), Choices())


def test_a_guessed_rotor_moves_more_than_itself(file: Callable[..., Path]) -> None:
    """5 ms of a Kd that is far too large is refused; the same rotor by the user's word is taken."""
    path = file(DOG)
    with pytest.raises(RobotFileError, match=r"a rotor of 15 kg·m² by its Kd of 3e\+03 .*--armature"):
        understand(read_robot(path), Choices(kd={"FL_knee": 3000.0}))
    given = understand(read_robot(path), Choices(kd={"FL_knee": 3000.0}, armature={"FL_knee": 15.0}))
    assert given.drives["FL_knee"].kd == 3000.0
