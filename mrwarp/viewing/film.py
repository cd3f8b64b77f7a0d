"""Films without a viewer: robots that walk side by side, rendered by MuJoCo, devices coloured by their gates."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from pathlib import Path

import mujoco
import numpy as np
from mujoco import mjtGeom
from PIL import Image, ImageDraw, ImageFont

from mrwarp.env.sim_model import Scene
from mrwarp.run_dir import atomic_write
from mrwarp.viewing import shapes
from mrwarp.viewing.frames import Frames, Gate
from mrwarp.viewing.robot_pictures import SideView
from mrwarp.viewing.shapes import GATE_COLORS, Color

SUFFIXES = (".gif", ".webp")
"""Forms of a film; a WebP is a fifth of a GIF's size."""

WIDTH, HEIGHT = 720, 340
"""Size of a film [pixels]."""

RATE = 16.7
"""Pictures of a film per second of simulated time, at most."""

SPACING = 0.75
"""Distance between robots that walk side by side [m], of a robot of the shipped one's size."""

AZIMUTH, ELEVATION = 128.0, -16.0
"""Where the camera looks from [deg]: the robots' right front, a person's view."""

LEGEND = ((Gate.HOLD, "holds"), (Gate.DYNAMIC, "damps"), (Gate.OFF, "coil off"))
"""States of a device, by the colour of its link."""


class NoRenderer(RuntimeError):
    """MuJoCo cannot render on this machine; the message says what to install."""

    exit_code = 2


class _Stage:
    """A MuJoCo model in which each drawn shape of each robot is a body that is placed by hand.

    Args:
        scene: What was simulated.
        robots: How many of it are drawn.
    """

    def __init__(self, scene: Scene, robots: int) -> None:
        self.unit = SideView(scene).unit
        self._scene, self._shapes = scene, shapes.robot_shapes(scene)
        spec = mujoco.MjSpec()
        spec.visual.global_.offwidth, spec.visual.global_.offheight = WIDTH, HEIGHT
        spec.visual.headlight.ambient, spec.visual.headlight.diffuse = [0.3] * 3, [0.25] * 3
        spec.visual.headlight.specular, spec.visual.quality.shadowsize = [0.0] * 3, 4096
        spec.stat.extent, spec.visual.map.shadowclip = self.unit * robots, 1.0
        spec.add_texture(
            name="sky",
            type=mujoco.mjtTexture.mjTEXTURE_SKYBOX,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_GRADIENT,
            rgb1=[0.97, 0.98, 1.0],
            rgb2=[0.82, 0.87, 0.93],
            width=64,
            height=64,
        )
        spec.add_texture(
            name="ground",
            type=mujoco.mjtTexture.mjTEXTURE_2D,
            builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
            rgb1=[0.86, 0.88, 0.9],
            rgb2=[0.78, 0.81, 0.84],
            width=256,
            height=256,
        )
        ground = spec.add_material(name="ground", texrepeat=[2, 2], texuniform=True)
        ground.textures[mujoco.mjtTextureRole.mjTEXROLE_RGB] = "ground"
        self._add_ground(spec)
        # from above: lower light draws stripes of its shadow map on flat ground
        spec.worldbody.add_body(name="sun", mocap=True).add_light(
            pos=[0, 0, 2], dir=[0.03, 0.05, -1], type=mujoco.mjtLightType.mjLIGHT_DIRECTIONAL, diffuse=[0.5] * 3
        )
        for k, shape in enumerate(self._shapes):
            if shape.points is not None and shape.faces is not None:
                spec.add_mesh(name=f"mesh{k}", uservert=shape.points.ravel(), userface=shape.faces.ravel())
        for robot in range(robots):
            for k, shape in enumerate(self._shapes):
                body = spec.worldbody.add_body(name=f"{robot}/{k}", mocap=True)
                color = [*(c / 255.0 for c in shape.part.value), 1.0]
                if shape.points is None:
                    body.add_geom(type=shape.kind, size=[*shape.size, 0.0, 0.0][:3], rgba=color)
                else:
                    body.add_geom(type=mjtGeom.mjGEOM_MESH, meshname=f"mesh{k}", rgba=color)
        self.model, self.data = (model := spec.compile()), mujoco.MjData(model)
        # MuJoCo moves a mesh to its centre of mass: each geom's frame in its body, taken off again when it is placed
        drawn = range(robots * len(self._shapes))
        self._geoms = np.array(
            [model.body(f"{k // len(self._shapes)}/{k % len(self._shapes)}").geomadr[0] for k in drawn]
        )

    def _add_ground(self, spec: mujoco.MjSpec) -> None:
        ground = shapes.ground_of(self._scene.model)
        if ground is None:
            spec.worldbody.add_geom(type=mjtGeom.mjGEOM_PLANE, size=[0, 0, 1], material="ground")
            return
        vertices, faces = ground.mesh()
        spec.add_mesh(name="ground", uservert=vertices.ravel(), userface=faces.ravel().astype(np.int32))
        spec.worldbody.add_geom(type=mjtGeom.mjGEOM_MESH, meshname="ground", rgba=[0.87, 0.89, 0.91, 1.0])

    def place(self, qpos: np.ndarray, gate: np.ndarray, offsets: np.ndarray) -> None:
        """Put all robots where they are.

        Args:
            qpos: Positions, shape (K, nq).
            gate: Gates of the devices, shape (K, M).
            offsets: Added to the positions [m], shape (K, 3).
        """
        pos, quat = shapes.body_poses(self._scene.model, qpos)
        count = len(self._shapes)
        for robot in range(len(qpos)):
            for k, shape in enumerate(self._shapes):
                geom, turn = robot * count + k, quat[robot, shape.body]
                at = geom + 1  # after the sun
                centre = pos[robot, shape.body] + shapes.rotate(turn, shape.pos) + offsets[robot]
                self.data.mocap_pos[at] = centre
                mujoco.mju_mulQuat(self.data.mocap_quat[at], turn, shape.quat)
                if shape.device >= 0:
                    color: Color = GATE_COLORS[Gate(int(gate[robot, shape.device]))]
                    self.model.geom_rgba[self._geoms[geom], :3] = np.array(color) / 255.0
        self.data.mocap_pos[0] = (qpos[:, :3] + offsets).mean(axis=0)  # shadows are drawn around the sun
        mujoco.mj_kinematics(self.model, self.data)
        mujoco.mj_camlight(self.model, self.data)


def film(scene: Scene, frames: Frames, currents: Sequence[float], path: Path, *, seconds: float = 4.0) -> None:
    """Save the last seconds of robots that walk side by side as an animation that repeats.

    Args:
        scene: What was simulated.
        frames: Its frames.
        currents: I_e of each robot [A].
        path: A file of one of :data:`SUFFIXES`.
        seconds: Length, in simulated time as in the film's [s].

    Raises:
        NoRenderer: MuJoCo finds neither EGL nor OSMesa nor a display.
    """
    frames = frames[frames.time > frames.time[-1] - seconds]
    frames = frames[:: max(1, round(1.0 / (RATE * float(np.median(np.diff(frames.time))))))]
    pictures = list(_pictures(scene, frames, currents))
    lasts = round(1000.0 * float(np.median(np.diff(frames.time))))
    form = {".gif": {"format": "GIF"}, ".webp": {"format": "WEBP", "quality": 70, "method": 6}}[path.suffix]
    with atomic_write(path) as partial:
        pictures[0].save(partial, save_all=True, append_images=pictures[1:], duration=lasts, loop=0, **form)


def _pictures(scene: Scene, frames: Frames, currents: Sequence[float]) -> Iterator[Image.Image]:
    """The pictures of a film, one per frame."""
    stage = _Stage(scene, len(currents))
    places = SPACING * stage.unit * np.arange(len(currents))
    start = frames.qpos[0, :, :2]
    camera = mujoco.MjvCamera()
    camera.azimuth, camera.elevation = AZIMUTH, ELEVATION
    camera.distance = stage.unit * (1.0 + 0.36 * len(currents))
    try:
        renderer = mujoco.Renderer(stage.model, HEIGHT, WIDTH)
    except Exception as error:  # any of OpenGL's loaders, each with errors of its own
        raise NoRenderer(
            f"MuJoCo cannot render here ({error}); install EGL or OSMesa (libegl1, libosmesa6) and set MUJOCO_GL=egl "
            "or MUJOCO_GL=osmesa, or take --png"
        ) from error
    with renderer:
        for k in range(len(frames)):
            offsets = np.zeros((len(currents), 3))
            # side by side at the start, each on its own way from there
            offsets[:, :2] = np.stack([np.zeros_like(places), places], axis=1) - start
            stage.place(frames.qpos[k], frames.gate[k], offsets)
            middle = (frames.qpos[k, :, :3] + offsets).mean(axis=0)
            camera.lookat[:] = (middle[0], places.mean(), 0.6 * float(frames.qpos[0, :, 2].mean()))
            renderer.update_scene(stage.data, camera)
            yield _labelled(Image.fromarray(renderer.render()), currents)


def _labelled(image: Image.Image, currents: Sequence[float]) -> Image.Image:
    """A picture with the currents of its robots, from the nearest on, and the colours' meaning."""
    draw, font = ImageDraw.Draw(image), ImageFont.load_default(15)
    order = "nearest" if len(currents) > 1 else ""
    text = (
        f"coil current, {order} first: " + ", ".join(f"{c:.4g}" for c in currents) + " A"
        if order
        else f"{currents[0]:.4g} A"
    )
    draw.text((12, 10), text, font=font, fill=(40, 44, 50))
    x = 12
    for gate, label in LEGEND:
        draw.rounded_rectangle((x, HEIGHT - 27, x + 16, HEIGHT - 11), 3, fill=GATE_COLORS[gate])
        draw.text((x + 22, HEIGHT - 28), label, font=font, fill=(40, 44, 50))
        x += 40 + int(draw.textlength(label, font=font))
    return image
