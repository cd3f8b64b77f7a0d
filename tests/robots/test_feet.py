"""Soles that are meshes, and wheels."""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from mrwarp.robots.drives import Choices
from mrwarp.robots.legs import understand
from mrwarp.robots.read_robot import read_robot
from mrwarp.robots.urdf import Meshes
from tests.robots.test_strange_robots import BALL, BOX, DOG, PLACES, WALKER, WHEEL, body, leg, legs_of


def mesh_asset(name: str, mesh: trimesh.Trimesh) -> str:
    """A mesh of an MJCF."""
    corners = " ".join(f"{x:.6g}" for x in np.asarray(mesh.vertices).ravel())
    return f'<asset><mesh name="{name}" vertex="{corners}"/></asset>'


def with_mesh(mesh: trimesh.Trimesh, pos: str, euler: str = "0 0 0") -> dict[str, str]:
    """A biped whose feet are meshes."""
    sole = f'<geom type="mesh" mesh="sole" mass="0" pos="{pos}" euler="{euler}"/>'
    return {"inner": WALKER.replace(BOX.format(at="0.03 0 -0.06"), sole), "head": mesh_asset("sole", mesh)}


@pytest.mark.parametrize("yaw", [0.0, 0.3])
def test_a_sole_that_is_a_mesh_becomes_a_box(file: Callable[..., Path], yaw: float) -> None:
    """Of its length, width and direction, at its bottom; the note says so."""
    sole = trimesh.creation.box((0.104, 0.042, 0.03))
    path = file(**with_mesh(sole, "0.02 0 -0.06", f"0 0 {yaw}"), limit=100.0)
    found = understand(read_robot(path), Choices())
    for foot in found.feet:
        assert foot.sole and foot.box is not None and foot.box in found.robot.shapes
        np.testing.assert_allclose(np.sort(2.0 * foot.box.size[:2]), (0.042, 0.104), atol=2e-3)
        corners = foot.box.pose.apply(foot.box.size * [[1, 1, -1], [-1, 1, -1], [1, -1, -1], [-1, -1, -1]])
        assert np.ptp(corners[:, 0]) == pytest.approx(0.104 * math.cos(yaw) + 0.042 * math.sin(yaw), abs=3e-3)
        np.testing.assert_allclose(corners[:, 2], -0.075, atol=2e-3)
        assert foot.centre[:2] == pytest.approx((0.02, 0.0), abs=2e-3)
    assert any("sole of left_foot, right_foot is a mesh: a box" in n and "104 x 42 mm" in n for n in found.notes)


def test_a_round_mesh_stays_a_point(file: Callable[..., Path]) -> None:
    """A ball of a mesh stands on a sphere that bears the load alone, which is said."""
    ball = trimesh.creation.icosphere(subdivisions=3, radius=0.02)
    inner = DOG.replace(BALL, '<geom type="mesh" mesh="tip" mass="0" pos="0 0 -0.2"/>')
    found = understand(read_robot(file(inner, head=mesh_asset("tip", ball))), Choices())
    assert all(foot.box is None and not foot.sole for foot in found.feet)
    assert any("no sphere below FL_calf" in n and "alone bears the load" in n for n in found.notes)


MESH_WHEEL = body(
    "{}_tyre", "0 0 -0.2", "{}_spin", "0 1 0", "", '<geom type="mesh" mesh="rim" euler="1.5708 0 0" mass="0"/>'
)
RIM = mesh_asset("rim", trimesh.creation.cylinder(0.07, 0.03, sections=24))


@pytest.mark.parametrize(
    ("shape", "motors", "unlimited"),
    [("cylinder", True, ()), ("cylinder", False, ()), ("cylinder", True, ("*_spin",)), ("mesh", True, ())],
)
def test_wheels_are_held_and_that_is_said(
    file: Callable[..., Path], shape: str, motors: bool, unlimited: tuple[str, ...]
) -> None:
    """No ankle is made of them, whether they have motors or the user calls them unlimited."""
    wheel, head = (WHEEL.replace("wheel", "tyre"), "") if shape == "cylinder" else (MESH_WHEEL, RIM)
    inner = "".join(leg(name, *at, shank=wheel.replace("{}", name)) for name, at in PLACES.items())
    path = file(inner, head=head, passive="nothing" if motors else "_spin")
    found = understand(read_robot(path), Choices(unlimited=unlimited))
    assert legs_of(found)["FL"] == ("FL_roll", "FL_pitch", "FL_knee") and len(found.layout.joints) == 12
    text = "wheels are not simulated: FR_spin, FL_spin, RR_spin and others are held"
    assert any(text in note for note in found.notes), found.notes


def test_what_spins_above_the_ground_is_no_wheel(file: Callable[..., Path]) -> None:
    """A lidar on the back turns without limits."""
    lidar = body("lidar", "0 0 0.1", "turn", "0 0 1", "", '<geom type="cylinder" size="0.03 0.02"/>')
    found = understand(read_robot(file(DOG + lidar)), Choices())
    assert "turn" in found.layout.joints and any("no limits for turn" in note for note in found.notes)


def test_soles_that_are_left_out_are_mentioned(file: Callable[..., Path]) -> None:
    """A shin's capsule stands in the place of a sole that --skip-meshes takes out: the note says why."""
    sole = with_mesh(trimesh.creation.box((0.104, 0.042, 0.03)), "0.02 0 -0.06")
    rod = '<geom type="capsule" fromto="0 0 0 0 0 -0.05" size="0.01"/>'
    path = file(sole["inner"].replace('<geom type="mesh"', f'{rod}<geom type="mesh"'), head=sole["head"], limit=100.0)
    assert any("box of its bounds" in note for note in understand(read_robot(path), Choices()).notes)
    bare = understand(read_robot(path, Meshes(skip=True)), Choices())
    assert all(foot.box is None for foot in bare.feet) and any("--skip-meshes left out" in note for note in bare.notes)
