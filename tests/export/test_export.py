"""An exported device is the kernel's: every law and effect, and many together, in C and in Python with NumPy alone."""

import ctypes
import functools
import importlib.util
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest

from mrwarp.actuator.joint_batch import JointBatch
from mrwarp.effects.catalogue import CATALOGUE, HYSTERESIS
from mrwarp.export.specialise import NotExportableError
from mrwarp.export.writers import export_device
from mrwarp.model_file import Effect, Model, ModelFileError, Parameter, load_model, make_effect
from mrwarp.resources import device_names
from tests.actuator.test_joint_batch import brake
from tests.effects.strengths import STRENGTHS
from tests.effects.test_hysteresis_laws import NUMBERS

DT, STEPS, JOINTS = 0.005, 240, 3
ACTING = [name for name, law in CATALOGUE.items() if law.kind == "mechanism"]
UNIT_LOOP = {"alpha": 0.0, "beta": 1.0, "gamma": 0.0, "K0": 0.2, "K1": 2.0}
BEFORE_THE_SHAFT = ("backlash", "series_compliance")
CC = shutil.which("cc")
needs_cc = pytest.mark.skipif(CC is None, reason="no C compiler 'cc' on this machine")


def device(*names: str) -> Model:
    """A model file's content with these laws and effects at strengths that show."""
    law = next((name for name in names if name in HYSTERESIS), None)
    values = {name: NUMBERS[name] if name in HYSTERESIS else STRENGTHS[name] for name in names}
    effects = tuple(make_effect(name, numbers) for name, numbers in values.items())
    return replace(brake(**(UNIT_LOOP if law else {})), effects=effects)


def motion(seed: int = 0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Angles, velocities and currents of three joints: a sine, a slow creep with a stop, and random turns."""
    rng = np.random.default_rng(seed)
    t = DT * np.arange(STEPS)
    turns = np.cumsum(rng.normal(0.0, 1.0, STEPS)) * 0.3
    qd = np.stack([2.4 * np.cos(8.0 * t), 0.15 * np.sin(3.0 * t) * (t > 0.3), turns - turns.mean()], axis=1)
    q = 0.1 + DT * np.cumsum(qd, axis=0)
    current = np.stack([1.2 * (np.sin(5.0 * t) > 0.0), 2.0 * t, np.abs(rng.normal(0.7, 0.5, STEPS))], axis=1)
    current[:20] = 0.0
    return q.astype(np.float32), qd.astype(np.float32), current.astype(np.float32)


def of_kernel(model: Model, q: np.ndarray, qd: np.ndarray, current: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and bound of the kernels, shape (STEPS, JOINTS)."""
    joints = JointBatch(model, JOINTS, dt=DT)
    rows = [(joints.step(*row), joints.bound()) for row in zip(q, qd, current, strict=True)]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


def loaded(path: Path) -> ModuleType:
    """A file of Python, imported."""
    spec = importlib.util.spec_from_file_location(path.stem, path)
    assert spec is not None and spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(module)
    return module


def of_python(path: Path, q: np.ndarray, qd: np.ndarray, current: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and bound of the exported file."""
    joints = loaded(path).Joints(JOINTS)
    rows = [(joints.step(*row), joints.bound) for row in zip(q, qd, current, strict=True)]
    return np.array([row[0] for row in rows]), np.array([row[1] for row in rows])


MAIN = """
#include "{name}.h"
void run(int steps, const float *q, const float *qd, const float *current, float *tau, float *bound)
{{
    {name} state = {{0}};
    for (int k = 0; k < steps; k++) {{
        tau[k] = {name}_step(&state, q[k], qd[k], current[k]);
        bound[k] = state.bound;
    }}
}}
"""


@functools.cache
def compiled(header: Path, source: str, *more: str) -> ctypes.CDLL:
    """A shared library around a header; every warning is an error."""
    name, library = header.stem, header.with_suffix(".so")
    header.with_suffix(".c").write_text(source.format(name=name))
    strict = "-std=c99 -Wall -Wextra -Wpedantic -Werror -Wconversion".split()
    line = [str(CC), *strict, "-O2", "-shared", "-fPIC", str(header.with_suffix(".c")), "-o", str(library), *more]
    done = subprocess.run([*line, "-lm"], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    return ctypes.CDLL(str(library))


def of_c(header: Path, q: np.ndarray, qd: np.ndarray, current: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Torque and bound of the compiled header."""
    run = compiled(header, MAIN).run
    array = np.ctypeslib.ndpointer(np.float32, flags="C")
    run.argtypes = [ctypes.c_int, *[array] * 5]
    tau, bound = np.empty_like(q), np.empty_like(q)
    for j in range(JOINTS):
        out = np.empty(STEPS, np.float32), np.empty(STEPS, np.float32)
        run(STEPS, *(np.ascontiguousarray(x[:, j]) for x in (q, qd, current)), *out)
        tau[:, j], bound[:, j] = out
    return tau, bound


Run = Callable[[Path, np.ndarray, np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]
WAYS: dict[str, Run] = {"python": of_python, **({"c": of_c} if CC else {})}
"""Languages."""
FAR = 1e-4
"""How far from the kernels they may be, as a share of the largest torque."""
MET_A_STEP_LATER = 0.01
"""Share of samples at which double precision may find a stop of the play one step earlier or later."""

SETS = [
    (),
    *((name,) for name in ACTING),
    *((law,) for law in HYSTERESIS),
    ("backlash", "series_compliance", "coil_lag"),
    *((law, name) for law in ("kwok", "dahl") for name in BEFORE_THE_SHAFT),
    ("lugre", "backlash", "series_compliance", "remanence", "command_delay"),
    tuple(name for name in ACTING if name not in BEFORE_THE_SHAFT),
]
"""Every law and effect that a model.json can hold, and some together."""


@pytest.mark.parametrize("names", SETS, ids=lambda names: "-".join(names)[:40] or "plain")
def test_it_is_the_kernel(names: tuple[str, ...], tmp_path: Path) -> None:
    """Torque and bound along the motion of three joints, to rounding, in every language."""
    model, data = device(*names), motion()
    wanted, files = of_kernel(model, *data), export_device(model, tmp_path, dt=DT)
    assert np.abs(wanted[0]).max() > 0.5
    for kind, run in WAYS.items():
        for a, b in zip(run(files[kind], *data), wanted, strict=True):
            far = np.abs(a - b) > FAR * np.abs(b).max()
            assert far.mean() <= (MET_A_STEP_LATER if "backlash" in names else 0.0), kind


@pytest.mark.parametrize("kind", WAYS)
def test_the_library_can_be_exported(kind: str, tmp_path: Path) -> None:
    """Every device in rad, A and N·m; one in other units is refused by its units, as everywhere."""
    found = 0
    for name in device_names():
        model = load_model(name)
        try:
            model.check_joint()
        except ModelFileError as error:
            with pytest.raises(ModelFileError, match="the simulator's joints are in"):
                export_device(model, tmp_path, dt=DT)
            assert "the simulator's joints are in" in str(error) and not (tmp_path / "mr_joint.h").exists()
            continue
        folder = tmp_path / name
        data = motion(seed=3)
        wanted = of_kernel(model, *data)[0]
        got = WAYS[kind](export_device(model, folder, dt=DT)[kind], *data)[0]
        far = np.abs(got - wanted) > FAR * np.abs(wanted).max()
        assert far.mean() <= MET_A_STEP_LATER
        found += 1
    assert found >= 1


@pytest.mark.parametrize("kind", WAYS)
@pytest.mark.parametrize("names", [(), ("remanence", "coulomb_friction", "command_delay")])
def test_a_negative_current_and_no_number(names: tuple[str, ...], kind: str, tmp_path: Path) -> None:
    """A negative current acts by its size up to the largest; NaN in any input is NaN out, in torque and bound."""
    (q, qd, current), run = motion(), WAYS[kind]
    file = export_device(device(*names), tmp_path, dt=DT)[kind]
    tau, bound = run(file, q, qd, current)
    for a, b in zip(run(file, q, qd, -current), (tau, bound), strict=True):
        np.testing.assert_allclose(a, b, atol=FAR * np.abs(b).max())
    for k in range(3):
        given = [q.copy(), qd.copy(), current.copy()]
        given[k][100, 1] = np.nan
        broken = run(file, *given)
        for a, b in zip(broken, (tau, bound), strict=True):
            assert np.isnan(a[100, 1])
            np.testing.assert_array_equal(np.delete(a, 1, axis=1), np.delete(b, 1, axis=1))
    assert np.isfinite(tau).all() and np.isfinite(bound).all()


def test_what_cannot_be_exported_is_named_and_nothing_is_written(tmp_path: Path) -> None:
    """An effect that the catalogue does not know, a step or a name that is none."""
    foreign = Effect(name="magic", parameters={"size": Parameter(value=1.0, unit="N·m")})
    with pytest.raises(NotExportableError, match="magic: unknown to the catalogue"):
        export_device(replace(device(), effects=(foreign,)), tmp_path, dt=DT)
    with pytest.raises(ValueError, match="dt = 0 s"):
        export_device(device(), tmp_path, dt=0)
    with pytest.raises(ValueError, match="name = 'a-b'; allowed: a letter"):
        export_device(device(), tmp_path, dt=DT, name="a-b")
    assert list(tmp_path.iterdir()) == []


ARM = """<mujoco>{include}<option timestep="{dt}" gravity="0 0 {gravity}"/><worldbody><body>
<joint name="knee" axis="0 1 0" {more}/><geom type="box" size="0.01 0.01 0.01" pos="0.3 0 0" mass="1"/></body>
</worldbody></mujoco>"""
INSTALL = """
#include "{name}_mujoco.h"
static {name}_brake brake;
int install(mjModel *m, mjData *d, int joint) {{ return {name}_install(&brake, m, d, joint); }}
float apply(mjModel *m, mjData *d, float current) {{ return {name}_apply(&brake, m, d, current); }}
"""


@needs_cc
def test_the_header_for_mujoco_is_the_brake(tmp_path: Path) -> None:
    """A falling arm with a rotor, a lag and a changing current goes as with :class:`mrwarp.mujoco.Brake`."""
    mujoco = pytest.importorskip("mujoco")
    from mrwarp.mujoco import Brake

    dt, angles, model = 0.002, [], device("coil_lag", "rotor_inertia")
    root = Path(mujoco.__file__).parent
    header = export_device(model, tmp_path, dt=dt)["c"]
    linked = ["-isystem", str(root / "include"), str(next(root.glob("libmujoco.so.*")))]
    library = compiled(header, INSTALL, *linked)
    library.apply.restype, library.apply.argtypes = ctypes.c_float, [ctypes.c_void_p] * 2 + [ctypes.c_float]
    library.install.argtypes = [ctypes.c_void_p] * 2 + [ctypes.c_int]
    for exported in (True, False):
        text = ARM.format(include="", dt=dt, gravity=-9.81, more='frictionloss="0.1"')
        m = mujoco.MjModel.from_xml_string(text)
        d = mujoco.MjData(m)
        d.qpos[0] = 0.1
        m.opt.timestep *= 2
        assert library.install(m._address, d._address, 0) == 0 or not exported  # of another step
        m.opt.timestep /= 2
        if exported:
            assert library.install(m._address, d._address, 0) == 1
        brake = None if exported else Brake(m, d, "knee", model)
        assert d.qpos[0] == 0.1
        path = []
        for k in range(400):
            if k == 100:
                mujoco.mj_setConst(m, mujoco.MjData(m))  # somebody recomputes what the brake has set
            current = 0.9 * (k % 100 > 50)
            if brake is None:
                library.apply(m._address, d._address, current)
            else:
                brake.step(current)
            mujoco.mj_step(m, d)
            path.append(d.qpos[0])
        angles.append(np.array(path))
    assert np.abs(angles[0][-1]) > 0.3
    np.testing.assert_allclose(angles[0], angles[1], atol=1e-4)


@pytest.mark.parametrize("state", ["off", "full"])
def test_the_snippet_slides_as_the_device(state: str, tmp_path: Path) -> None:
    """At a steady speed the attributes give the kernel's torque: they say no more, and no less."""
    mujoco = pytest.importorskip("mujoco")
    model = replace(brake(alpha=0.0, C=0.0, D=0.0, I1=0.0), effects=(make_effect("current_saturation", {"u": 0.6}),))
    export_device(model, tmp_path, dt=0.002)
    text = ARM.format(
        include='<include file="mr_joint_mujoco.xml"/>', dt=0.002, gravity=0, more=f'class="mr_joint_{state}"'
    )
    (tmp_path / "arm.xml").write_text(text)
    m = mujoco.MjModel.from_xml_path(str(tmp_path / "arm.xml"))
    d = mujoco.MjData(m)
    d.qvel[0] = 0.5
    mujoco.mj_step(m, d)
    joints = JointBatch(model, dt=0.002)
    speed = float(d.qvel[0])
    for _ in range(1000):
        torque = joints.step(0.0, speed, 1.5 if state == "full" else 0.0)[0]
    assert -(d.qfrc_constraint[0] + d.qfrc_passive[0]) == pytest.approx(torque, rel=0.01)
