"""Robots written for the tests: legs of a hip, a thigh and a shank on a box, in MJCF."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest

LEG = """
<body name="{name}_hip" pos="{x} {y} 0">
  <inertial pos="0 0 0" mass="{hip}" diaginertia="0.002 0.002 0.002"/>
  <joint name="{name}_roll" type="hinge" axis="1 0 0" range="-0.7 0.7" armature="0.01"/>
  <body name="{name}_upper" pos="0 {out} 0">
    <inertial pos="0 0 -0.1" mass="{thigh}" diaginertia="0.01 0.01 0.002"/>
    <joint name="{name}_pitch" type="hinge" axis="0 1 0" range="-1.5 3" armature="0.01"/>
    <geom type="capsule" fromto="0 0 -0.02 0 0 -0.2" size="0.02"/>
    <body name="{name}_lower" pos="0.01 0 -0.25">
      <inertial pos="0 0 -0.1" mass="{shank}" diaginertia="0.004 0.004 0.0004"/>
      <joint name="{name}_knee" type="hinge" axis="0 1 0" range="-2.6 -0.4" armature="0.01"/>
      {foot}
    </body>
  </body>
</body>
"""

SPHERE = '<geom name="{name}_toe" type="sphere" size="0.025" pos="0.005 0 -0.24" friction="0.7"/>'
BOX = '<geom name="{name}_toe" type="box" size="0.04 0.03 0.01" pos="0.005 0 -0.24" friction="0.7"/>'

Robot = Callable[..., Path]


@pytest.fixture(scope="session")
def robot(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    """Writes a robot with any number of legs; returns its file."""

    def write(
        places: Sequence[tuple[float, float]] = ((-0.3, -0.1), (-0.3, 0.1), (0.3, -0.1), (0.3, 0.1)),
        *,
        foot: str = SPHERE,
        limit: float | None = 30.0,
        keyframe: Sequence[float] | None = None,
        tail: str = "",
        more: str = "",
        head: str = "",
    ) -> Path:
        names = [f"leg_{chr(97 + k)}" for k in range(len(places))]
        masses = {"hip": 0.6, "thigh": 1.1, "shank": 0.4}
        legs = "".join(
            LEG.format(name=name, x=x, y=y, out=0.08 if y > 0 else -0.08, foot=foot.format(name=name), **masses)
            for name, (x, y) in zip(names, places, strict=True)
        )
        joints = [f"{name}_{part}" for name in names for part in ("roll", "pitch", "knee")]
        motors = "".join(f'<motor joint="{joint}" ctrlrange="-{limit} {limit}"/>' for joint in joints) if limit else ""
        pose = " ".join(map(str, [0, 0, 0.4, 1, 0, 0, 0, *(keyframe or ())]))
        key = f'<keyframe><key name="home" qpos="{pose}"/></keyframe>' if keyframe else ""
        path = tmp_path_factory.mktemp("robot") / "beast.xml"
        path.write_text(
            '<mujoco model="beast"><compiler angle="radian"/>'
            f'{head}<worldbody><body name="torso" pos="0 0 0.6">'
            '<freejoint/><inertial pos="0 0 0" mass="8" diaginertia="0.1 0.3 0.3"/>'
            f'<geom type="box" size="0.3 0.1 0.05"/>{legs}{tail}</body>{more}</worldbody>'
            f"<actuator>{motors}</actuator>{key}</mujoco>"
        )
        return path

    return write


@pytest.fixture
def file(tmp_path: Path) -> Callable[..., Path]:
    """Writes a robot of its legs."""

    def write(
        inner: str,
        *,
        limit: float = 30.0,
        kp: float = 40.0,
        root: str = "",
        more: str = "",
        free: bool = True,
        head: str = "",
        passive: str = "nothing",
        **_: object,
    ) -> Path:
        names = [part.split('"')[0] for part in inner.split('<joint name="')[1:]]
        names = [name for name in names if passive not in name]
        servo = f'kp="{kp}" forcerange="-{limit} {limit}"'
        servos = "".join(f'<position joint="{name}" {servo}/>' for name in names)
        path = tmp_path / "strange.xml"
        path.write_text(
            f'<mujoco><compiler angle="radian"/>{head}<worldbody><body name="trunk" pos="0 0 1" {root}>'
            f"{'<freejoint/>' * free}"
            '<inertial pos="0 0 0" mass="8" diaginertia="0.1 0.1 0.1"/><geom type="box" size="0.12 0.1 0.045"/>'
            f"{inner}</body></worldbody><actuator>{servos}</actuator>{more}</mujoco>",
            encoding="utf-8",
        )
        return path

    return write


def _random_urdf(rng: np.random.Generator, *, held: bool, links: int = 9) -> str:
    """A tree whose links hang on fixed joints as often as on hinges, with offsets and rotated inertias."""

    def place() -> str:
        xyz, rpy = rng.uniform(-0.3, 0.3, 3), rng.uniform(-1.5, 1.5, 3)
        return f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'

    text = '<link name="world"/>' * held
    for k in range(links):
        mass, (a, b, c) = rng.uniform(0.1, 3.0), rng.uniform(0.001, 0.01, 3)
        inertia = f'<inertia ixx="{b + c}" iyy="{a + c}" izz="{a + b}" ixy="0" ixz="0" iyz="0"/>'
        text += f'<link name="l{k}"><inertial>{place()}<mass value="{mass}"/>{inertia}</inertial></link>'
        if k == 0 and not held:
            continue
        kind = "fixed" if k == 0 or rng.random() < 0.5 else "continuous"
        axis = f'<axis xyz="{" ".join(map(str, rng.normal(size=3)))}"/><limit effort="9" velocity="9"/>'
        parent = "world" if k == 0 else f"l{rng.integers(k)}"
        ends = f'<parent link="{parent}"/><child link="l{k}"/>'
        text += f'<joint name="j{k}" type="{kind}">{place()}{ends}{axis * (kind != "fixed")}</joint>'
    return f'<robot name="tree">{text}</robot>'


@pytest.fixture
def random_urdf() -> Callable[..., str]:
    """Writes trees with fixed joints."""
    return _random_urdf
