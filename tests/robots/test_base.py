"""Robots whose file does not say whether they float: noted, asked, or decided by --base."""

from collections.abc import Callable
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.robots.drives import Choices
from mrwarp.robots.foreign import RobotFileError
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.usd.asset import load_robot, masses
from tests.robots.test_foreign_files import joint, link, urdf, usd
from tests.robots.test_strange_robots import DOG, ROD, body, legs_of, walker

FLOOR = '</worldbody><worldbody><body name="table"><geom type="box" size="1 1 0.1"/></body>'
ARM = body("upper", "0 0 0.1", "shoulder", "0 1 0", "-2 2", ROD.format(end="0 0 0.3"), 2.0)


def test_a_dog_without_a_free_joint_is_asked_about(file: Callable[..., Path]) -> None:
    """One refusal with what would be held and both answers; each answer does what it says, and no mass is lost."""
    path = file(DOG, free=False)
    with pytest.raises(RobotFileError) as error:
        understand(read_robot(path), Choices())
    for part in ("no free joint", "trunk (8.00 kg)", "4 limbs", "FR_calf", "--base free", "--base fixed"):
        assert part in str(error.value)
    free = understand(read_robot(path, base="free"), Choices())
    said = understand(read_robot(file(DOG)), Choices())
    assert free.layout == said.layout and free.height == said.height
    held = understand(read_robot(path, base="fixed"), Choices())
    assert not held.layout.legs and sum(b.mass for b in held.robot.bodies) == pytest.approx(8.0 + 4 * 1.6)
    assert any("trunk (8.00 kg) stands still, 6.40 kg move" in note for note in held.notes)


def test_two_legs_without_a_free_joint_are_asked_about(file: Callable[..., Path]) -> None:
    """A biped on a stand, or two arms."""
    path = file(walker("left", 0.1) + walker("right", -0.1), limit=100.0, free=False)
    with pytest.raises(RobotFileError, match="2 limbs of one build .*--base free .*--base fixed"):
        understand(read_robot(path), Choices())
    assert tuple(legs_of(understand(read_robot(path, base="free"), Choices()))) == ("left", "right")


def test_an_arm_says_what_is_held(
    file: Callable[..., Path], tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The base with its weight, not the table next to it; the total counts it."""
    path = file(ARM, free=False)
    path.write_text(path.read_text().replace("</worldbody>", FLOOR + "</worldbody>"))
    out = tmp_path / "arm.usda"
    assert main(["robot", "import", str(path), "--out", str(out)]) == 0
    said = capsys.readouterr().out
    assert "10.00 kg, 2.00 kg of it on trunk (8.00 kg), which stands still, 0 legs" in said
    assert "trunk (8.00 kg) stands still, 2.00 kg move (no free joint); --base free lets it float" in said
    assert sum(masses(load_robot(robot=str(out))).values()) == pytest.approx(10.0)


def test_a_dog_that_is_held(file: Callable[..., Path]) -> None:
    """A free joint gives way to the user's word, for any keyframes."""
    found = understand(read_robot(file(DOG), base="fixed"), Choices())
    assert not found.layout.legs and len(found.layout.joints) == 12 and not found.robot.floating


def test_a_hinge_at_the_world_leaves_nothing_to_float(file: Callable[..., Path]) -> None:
    """No base, no freedom."""
    path = file("", free=False)
    arm = body("link", "0 0 1", "pivot", "0 1 0", "-1 1", ROD.format(end="0 0 0.3"))
    path.write_text(f'<mujoco><compiler angle="radian"/><worldbody>{arm}</worldbody></mujoco>')
    with pytest.raises(RobotFileError, match="--base free: pivot joins link to the world"):
        read_robot(path, base="free")


def arm_urdf(folder: Path, first: str = "", **choices: str) -> Path:
    """An arm of two links on a base."""
    text = first + link("base") + link("a") + link("b")
    text += joint("j1", "base", "a", **choices) + joint("j2", "a", "b", at="0 0 0.3")
    (folder / "arm.urdf").write_text(f"<robot>{text}</robot>")
    return folder / "arm.urdf"


def test_an_arm_in_urdf_without_a_world(tmp_path: Path) -> None:
    """It is asked about, hanging or standing; --base fixed holds it; a world that is only named is the ground."""
    for at in ("0 0 0.3", "0 0 -0.3"):
        path = arm_urdf(tmp_path, at=at)
        with pytest.raises(RobotFileError, match="arm, which has no legs, needs --base fixed; .*--base free"):
            understand(read_robot(path), Choices())
    held = understand(read_robot(path, base="fixed"), Choices())
    assert held.layout.trunk == "base" and held.layout.joints == ("j1", "j2") and not held.robot.floating
    weld = joint("weld", "world", "base", kind="fixed", limit="")
    found = understand(read_robot(arm_urdf(tmp_path, weld)), Choices())
    assert not found.robot.floating and sum(body.mass for body in found.robot.bodies) == 3.0
    assert any("weld names a link world that the file lacks" in n for n in found.notes)


def test_a_dog_in_urdf_on_a_stand(tmp_path: Path) -> None:
    """A world that bears four legs is asked about; a floating joint there lets it float."""
    for kind in ("fixed", "floating"):
        path = urdf(tmp_path, link("world", mass=None) + joint("mount", "world", "trunk", kind=kind, limit=""))
        if kind == "fixed":
            with pytest.raises(RobotFileError, match=r"the file holds trunk \(8.00 kg\) .*4 limbs .*--base free"):
                understand(read_robot(path), Choices())
        found = understand(read_robot(path, base="free" if kind == "fixed" else None), Choices())
        assert found.layout.trunk == "trunk" and len(found.layout.legs) == 4
        assert not understand(read_robot(path, base="fixed"), Choices()).layout.legs


def test_usd_is_held_by_the_users_word(tmp_path: Path) -> None:
    """And floats without it."""
    assert len(understand(read_robot(usd(tmp_path)), Choices()).layout.legs) == 4
    (tmp_path / "held").mkdir()
    assert not understand(read_robot(usd(tmp_path / "held"), base="fixed"), Choices()).layout.legs
