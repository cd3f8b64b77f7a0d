"""A USD stage as Newton converts it to MuJoCo, kept in a cache: loading Newton takes ten times as long as the rest.

An entry is a file that is named by a digest of all that the conversion depends on: the composed stage without its
drives, the ground, the versions of the libraries, this file. Drives are no part of it, so that other numbers of a
device need no conversion.
"""

from __future__ import annotations

import contextlib
import hashlib
import os
import tempfile
from dataclasses import dataclass
from pathlib import Path

import mujoco
import numpy as np
from pxr import Sdf, Usd

from mrwarp.run_dir import library_version, write_bytes
from mrwarp.runtime import uncollected
from mrwarp.usd.open_stage import keep_fixed_joints

CACHE_BYTES = 2**28
"""Largest size of the cache [bytes], some hundred robots: the entries that were used last stay."""

LIBRARIES = ("newton", "newton-usd-schemas", "usd-core", "mujoco", "warp-lang", "numpy", "trimesh")
"""Inputs of a conversion."""

DRIVE = "NewtonActuator"
"""Type of the prims that drive joints: nothing of them is in the MuJoCo model."""

_SUFFIX = ".converted"


@dataclass(frozen=True, kw_only=True)
class Field:
    """Heights on a square grid, centred on the world's origin."""

    heights: np.ndarray
    """[m], float32, shape (rows along y, columns along x)."""
    cell: float
    """Spacing [m]."""
    origins: np.ndarray
    """Middle of each tile (x, y), and the highest ground under a robot there [m], float32, (levels, kinds, 3)."""

    @property
    def half(self) -> tuple[float, float]:
        """Half the extent along x and y [m]."""
        rows, columns = self.heights.shape
        return 0.5 * self.cell * (columns - 1), 0.5 * self.cell * (rows - 1)


def converted(stage: Usd.Stage, ground: bool | Field) -> tuple[str, mujoco.MjModel]:
    """MJCF text and MuJoCo model of a stage, its variants chosen, from the cache where it holds them.

    Args:
        stage: The robot.
        ground: Add a ground plane at z = 0, or a height field.
    """
    folder = cache_folder()
    file = folder and folder / f"{_digest(stage, ground)}{_SUFFIX}"
    if file and (found := _read(file)):
        return found
    with uncollected():
        made = convert_stage(stage, ground)
    if file:
        _keep(file, *made)
    return made


def cache_folder() -> Path | None:
    """Folder of the cache: in Warp's where ``WARP_CACHE_PATH`` names one, else in the user's next to Warp's.

    None: the user has no home.
    """
    named, user = os.environ.get("WARP_CACHE_PATH"), os.environ.get("XDG_CACHE_HOME")
    try:
        return (Path(named) if named else Path(user) if user else Path("~/.cache").expanduser()) / "mrwarp"
    except RuntimeError:
        return None


def _digest(stage: Usd.Stage, ground: bool | Field) -> str:
    """Name of what a conversion gives."""
    flat = stage.Flatten()
    flat.documentation = ""  # names the file
    drives: list[Sdf.Path] = []

    def visit(path: Sdf.Path) -> None:
        prim = flat.GetPrimAtPath(path) if path.IsPrimPath() else None
        # a class is composed into what inherits from it
        if prim is not None and (prim.typeName == DRIVE or prim.specifier == Sdf.SpecifierClass):
            drives.append(path)

    flat.Traverse(Sdf.Path.absoluteRootPath, visit)
    edit = Sdf.BatchNamespaceEdit()
    for path in Sdf.Path.RemoveDescendentPaths(drives):
        edit.Add(path, Sdf.Path.emptyPath)
    flat.Apply(edit)
    digest = hashlib.sha256(Path(__file__).read_bytes())
    digest.update(repr([library_version(name) for name in LIBRARIES]).encode())
    digest.update(flat.ExportToString().encode())
    if isinstance(ground, Field):
        digest.update(repr((ground.heights.shape, ground.cell)).encode() + ground.heights.tobytes())
    else:
        digest.update(repr(ground).encode())
    return digest.hexdigest()


def _read(file: Path) -> tuple[str, mujoco.MjModel] | None:
    """An entry; None where there is none, or a damaged one."""
    try:
        content = file.read_bytes()
        os.utime(file)  # used last
    except OSError:
        return None
    # MuJoCo may crash on a damaged model, so nothing of an entry is used before its digest is right
    digest, size, body = content[:32], int.from_bytes(content[32:40], "little"), content[40:]
    if hashlib.sha256(content[32:]).digest() != digest:
        return None
    return body[:size].decode(), mujoco.MjModel.from_binary_path("kept.mjb", {"kept.mjb": body[size:]})


def _keep(file: Path, text: str, model: mujoco.MjModel) -> None:
    """Write an entry, and remove those that were not used for longest; without a folder to write to nothing is kept."""
    binary = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, binary)
    mjcf = text.encode()
    content = len(mjcf).to_bytes(8, "little") + mjcf + binary.tobytes()
    with contextlib.suppress(OSError):
        write_bytes(file, hashlib.sha256(content).digest() + content)
        states = {entry: entry.stat() for entry in file.parent.glob(f"*{_SUFFIX}")}
        room = CACHE_BYTES
        for entry in sorted(states, key=lambda entry: states[entry].st_mtime_ns, reverse=True):
            room -= states[entry].st_size
            if room < 0:
                entry.unlink(missing_ok=True)


def convert_stage(stage: Usd.Stage, ground: bool | Field) -> tuple[str, mujoco.MjModel]:
    """MJCF text and MuJoCo model, made by Newton."""
    import newton  # it takes seconds to load

    session = Sdf.Layer.CreateAnonymous("session.usda")
    session.TransferContent(stage.GetSessionLayer())
    bare = Usd.Stage.Open(stage.GetRootLayer(), session)
    with Usd.EditContext(bare, session):
        for prim in [prim for prim in bare.Traverse() if prim.GetTypeName() == DRIVE]:
            prim.SetActive(False)
        keep_fixed_joints(bare)
    builder = newton.ModelBuilder()
    newton.solvers.SolverMuJoCo.register_custom_attributes(builder)
    builder.add_usd(bare)
    # no contact gap, as on the asset's shapes: feet near the ground would count as contacts
    surface = newton.ModelBuilder.ShapeConfig(gap=0.0)
    if isinstance(ground, Field):
        # half a metre thick below its lowest point, so that a foot pressed into it stays inside
        (rows, columns), (half_x, half_y) = ground.heights.shape, ground.half
        shape = newton.Heightfield(data=ground.heights, nrow=rows, ncol=columns, hx=half_x, hy=half_y)
        thick = {"mujoco:hfield_base": 0.5}
        builder.add_shape_heightfield(heightfield=shape, cfg=surface, label="terrain", custom_attributes=thick)
    elif ground:
        builder.add_ground_plane(cfg=surface)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "model.xml"
        solver = newton.solvers.SolverMuJoCo(
            builder.finalize(device="cpu"), save_to_mjcf=str(path), use_mujoco_cpu=True
        )
        assert solver.mj_model is not None  # what its conversion to MuJoCo makes
        return path.read_text(encoding="utf-8"), solver.mj_model
