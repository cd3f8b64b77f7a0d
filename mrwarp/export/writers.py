"""Files of an exported device: a C header, a file of Python, and a header and a snippet for plain MuJoCo."""

from __future__ import annotations

import math
import re
from collections.abc import Callable
from pathlib import Path

from mrwarp.actuator import brake_constraint
from mrwarp.export.device_program import DeviceProgram, device_program
from mrwarp.export.languages import CWriter, c_constants, c_number, python_function
from mrwarp.model_file import Model, silent_note
from mrwarp.run_dir import library_version, write_text

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]*")
"""Names that C and Python have in common."""


def export_device(model: Model, out: Path, *, dt: float, name: str = "mr_joint") -> dict[str, Path]:
    """Write a device in other languages.

    Args:
        model: The device.
        out: Folder.
        dt: Step of the host [s].
        name: Front of files, functions and constants.

    Returns:
        Files by what they are: ``c``, ``python``, ``mujoco_c``, ``mujoco_xml``.

    Raises:
        ModelFileError: the model is not in rad, A and N·m, or a value is out of range.
        NotExportableError: the model has an effect that the catalogue does not know.
        ValueError: the step is not positive and finite, or the name is none in C and Python.
    """
    if not IDENTIFIER.fullmatch(name):
        raise ValueError(f"name = {name!r}; allowed: a letter, then letters, digits and underscores")
    device = device_program(model, dt)
    texts: dict[str, tuple[str, Callable[[DeviceProgram, str], str]]] = {
        "c": (f"{name}.h", c_header),
        "python": (f"{name}.py", python_file),
        "mujoco_c": (f"{name}_mujoco.h", mujoco_header),
        "mujoco_xml": (f"{name}_mujoco.xml", mujoco_snippet),
    }
    made = {kind: (file, write(device, name)) for kind, (file, write) in texts.items()}
    return {kind: write_text(out / file, text) for kind, (file, text) in made.items()}


def origin(device: DeviceProgram) -> list[str]:
    """Lines on where an export comes from and what it has."""
    found = [
        f"A magnetorheological joint: made by mrwarp {library_version('mrwarp')} from the fit of "
        f"{device.model.fitted_on.source}.",
        f"It has eqs. 14, 15 and 18 of the paper{_with(device.acting)}.",
    ]
    note = silent_note(device.model.effects)
    return [*found, *([f"Not in it, as it {note}."] if note else [])]


def _with(acting: tuple[str, ...]) -> str:
    return f" with {', '.join(acting)}" if acting else ""


def c_header(device: DeviceProgram, name: str) -> str:
    """The device as a C header."""
    writer, program = CWriter(device.program, name), device.program
    functions = [writer.function(function) for function in program.functions.values()]
    NAME = name.upper()
    fields = [f"    {kind} {field};" for field, kind in device.state.items()]
    fields += [f"    float memory[{len(program.slots)}];"] if program.slots else []
    fields += [f"    float commands[{NAME}_COMMANDS];"] if device.depth else []
    program.used |= {"DT"} | ({"COMMANDS"} if device.depth else set())
    path = [f"typedef struct {{ float {', '.join(sorted(program.fields))}; }} {name}_path;"] if program.fields else []
    lines = [
        "/* " + "\n * ".join(_plain(line) for line in origin(device)),
        " *",
        f" * {name} state = {{0}};            a joint at rest without current",
        f" * tau = {name}_step(&state, q, qd, current);   once every {NAME}_DT seconds",
        " *",
        " * q [rad] as in the recordings, qd [rad/s], current [A]; tau [N*m] is positive against a positive qd: apply",
        " * -tau. A brake that holds needs state.bound [N*m] instead, the dry friction that the device may use. With",
        " * the inertia J [kg*m^2] and all other torques in sum, load [N*m], it stands or is caught in each step DT by",
        f" *     free = qd + load / J * {NAME}_DT;          most = state.bound / J * {NAME}_DT;",
        f" *     qd = free - fminf(fmaxf(free, -most), most);   q += qd * {NAME}_DT;",
        f" * J has {NAME}_INERTIA in it. NaN in gives NaN out; do not use -ffast-math.",
        " */",
        f"#ifndef {NAME}_H",
        f"#define {NAME}_H",
        "#include <math.h>",
        "",
        f"#define {NAME}_INERTIA {c_number(device.inertia)} /* kg*m^2 */",
        *c_constants(program, writer, device.docs),
        "",
        "typedef struct {",
        *fields,
        f"}} {name};",
        *path,
        "",
        f"static inline float {name}_sign(float x) {{ return x < 0.0f ? -1.0f : 1.0f; }}",
        f"static inline float {name}_clamp(float x, float low, float high) {{ return fminf(fmaxf(low, x), high); }}",
        "",
        "\n\n".join(functions),
        "",
        f"#endif /* {NAME}_H */",
    ]
    return "\n".join(lines) + "\n"


def python_file(device: DeviceProgram, name: str) -> str:
    """The device as one file of Python, with NumPy alone."""
    program = device.program
    functions = [python_function(function) for function in program.functions.values()]
    program.used |= {"DT"}
    numbers = [f"{k} = {v!r}  # {u}" for k, (v, u) in program.numbers.items() if k in program.used]
    start = [f"self.{field} = {'0' if kind == 'int' else '0.0'}" for field, kind in device.state.items()]
    start += [f"self.memory = [0.0] * {len(program.slots)}"] if program.slots else []
    start += ["self.commands = [0.0] * COMMANDS"] if device.depth else []
    fields = ", ".join(f'"{field}"' for field in sorted(program.fields))
    return PYTHON.format(
        origin="\n".join(origin(device)),
        name=name,
        numbers="\n".join([f"INERTIA = {device.inertia!r}  # kg*m^2, to be added to the joint's inertia", *numbers]),
        start="\n        ".join(start),
        path=PATH.format(fields=fields) if fields else "",
        functions="\n\n\n".join(functions),
    )


PYTHON = '''"""{origin}

    import numpy as np
    from {name} import Joints

    joints = Joints(3)
    torque = joints.step(q, qd, current)  # arrays of 3: [rad], [rad/s], [A] -> [N*m], once every DT seconds

The torque is positive against a positive velocity: apply its negative. A brake that holds needs ``joints.bound`` [N*m]
instead, the dry friction that each device may use. With the inertia J [kg*m^2], INERTIA in it, and all other torques in
sum, load [N*m], a joint stands or is caught in each step by

    free = qd + load / J * DT
    qd = free - np.clip(free, -joints.bound / J * DT, joints.bound / J * DT)
    q = q + qd * DT

NaN in gives NaN out.
"""

import math

import numpy as np

{numbers}


def exp(x):
    return math.exp(min(x, 709.0))


def log(x):
    return math.log(x) if x > 0.0 else -math.inf if x == 0.0 else math.nan


def pow(x, y):
    return x**y if x > 0.0 or x != x else 0.0


def sign(x):
    return -1.0 if x < 0.0 else 1.0


def clamp(x, low, high):
    return min(max(low, x), high)


{path}class Joint:
    """State of one joint: at rest, without current and stress."""

    def __init__(self):
        {start}


{functions}


class Joints:
    """N joints with this device."""

    def __init__(self, num=1):
        self.num = num
        self.joints = [Joint() for _ in range(num)]

    def reset(self):
        """All at rest, without current and stress; the session, over which devices wear, goes on."""
        for joint in self.joints:
            steps = getattr(joint, "steps", 0)
            joint.__init__()
            if steps:
                joint.steps = steps

    def step(self, q, qd, current):
        """Torque [N*m] of the step that begins in this state, shape (N,); each argument (N,) or one number."""
        rows = zip(*(np.broadcast_to(np.asarray(x, dtype=float), (self.num,)).tolist() for x in (q, qd, current)))
        return np.array([step(joint, *row) for joint, row in zip(self.joints, rows)])

    @property
    def bound(self):
        """Dry friction that each device may use in the step just made [N*m], shape (N,)."""
        return np.array([joint.bound for joint in self.joints])
'''


PATH = '''class Path:
    """One step of a joint."""

    __slots__ = ({fields},)

    def __init__(self):
        for name in self.__slots__:
            setattr(self, name, 0.0)


'''


def mujoco_header(device: DeviceProgram, name: str) -> str:
    """C that makes the device a brake of a plain MuJoCo model, as :class:`mrwarp.mujoco.Brake` does in Python."""
    NAME, impedance = name.upper(), f"{brake_constraint.IMPEDANCE!r}"
    solimp = ", ".join(repr(float(x)) for x in brake_constraint.SOLIMP)
    return MUJOCO.format(
        origin="\n * ".join(_plain(line) for line in origin(device)),
        name=name,
        NAME=NAME,
        impedance=impedance,
        creep=repr(brake_constraint.CREEP),
        solimp=solimp,
        iterations=brake_constraint.MIN_LS_ITERATIONS,
    )


MUJOCO = """/* {origin}
 *
 * {name}_brake brake;
 * {name}_install(&brake, m, d, joint);     once, a hinge of a model whose timestep is {NAME}_DT; 0 if it is not
 * {name}_apply(&brake, m, d, current);     before every mj_step: sets the friction of the step that follows
 * memset(&brake.joint, 0, sizeof brake.joint);   with every mj_resetData: at rest, without current
 */
#ifndef {NAME}_MUJOCO_H
#define {NAME}_MUJOCO_H
#include <mujoco/mujoco.h>
#include <string.h>
#include "{name}.h"

typedef struct {{
    {name} joint;
    int q, v;     /* places in qpos and qvel */
    mjtNum own;   /* dry friction that the joint has without the device [N*m] */
}} {name}_brake;

/* Makes the joint's dry friction passive in discrete time; again in every step, as MuJoCo derives it from the inertia
 * whenever somebody recomputes constants. */
static inline void {name}_prepare(const {name}_brake *brake, mjModel *m)
{{
    const mjtNum impedance = {impedance}, solimp[mjNIMP] = {{{solimp}}};
    const mjtNum dt = m->opt.timestep;
    m->dof_solref[mjNREF * brake->v] = 2 * dt / impedance;
    m->dof_solref[mjNREF * brake->v + 1] = 1;
    memcpy(m->dof_solimp + mjNIMP * brake->v, solimp, sizeof solimp);
    m->dof_invweight0[brake->v] = {creep} / dt * impedance / (1 - impedance);
}}

/* Makes the joint a brake and adds the rotor; the pose stays. Returns 1, or 0 with nothing changed. */
static inline int {name}_install({name}_brake *brake, mjModel *m, const mjData *d, int joint)
{{
    const mjtNum dt = m->opt.timestep;
    const int v = m->jnt_dofadr[joint];
    (void)d;
    if (m->jnt_type[joint] != mjJNT_HINGE || fabs(dt - (mjtNum){NAME}_DT) > 1e-6 * dt)
        return 0;
    memset(brake, 0, sizeof *brake);
    brake->q = m->jnt_qposadr[joint];
    brake->v = v;
    brake->own = m->dof_frictionloss[v];
    if ({NAME}_INERTIA != 0.0f) {{
        mjData *scratch = mj_makeData(m);
        m->dof_armature[v] += (mjtNum){NAME}_INERTIA;
        mj_setConst(m, scratch);
        mj_deleteData(scratch);
    }}
    {name}_prepare(brake, m);
    if (m->opt.ls_iterations < {iterations})
        m->opt.ls_iterations = {iterations};
    return 1;
}}

/* Returns the device's bound [N*m]; NaN, with the friction as it was, where an input is none. */
static inline float {name}_apply({name}_brake *brake, mjModel *m, const mjData *d, float current)
{{
    {name}_prepare(brake, m);
    {name}_step(&brake->joint, (float)d->qpos[brake->q], (float)d->qvel[brake->v], current);
    if (brake->joint.bound == brake->joint.bound)
        m->dof_frictionloss[brake->v] = brake->own + (mjtNum)brake->joint.bound;
    return brake->joint.bound;
}}

#endif /* {NAME}_MUJOCO_H */
"""


def mujoco_snippet(device: DeviceProgram, name: str) -> str:
    """Attributes of a joint that stay what they are: the device at a fixed current, sliding slowly."""
    params = device.params
    currents = {"off": 0.0, "full": params.coil.current_max}
    rows = []
    for state, current in currents.items():
        attributes = {
            "frictionloss": f"{slow_friction(device, current):.6g}",
            "damping": f"{params.bouc_wen.B:.6g}",
            "armature": f"{device.inertia:.6g}",
            "solreffriction": " ".join(f"{x:.6g}" for x in brake_constraint.solref(device.dt)),
            "solimpfriction": " ".join(f"{x:.6g}" for x in brake_constraint.SOLIMP),
        }
        text = " ".join(f'{key}="{value}"' for key, value in attributes.items())
        rows.append(f'    <default class="{name}_{state}"><joint {text}/></default> <!-- {current:g} A -->')
    left = [
        "C of eq. 14",
        "the holding torque of eq. 18",
        "the way over which the hysteresis builds up",
        *device.acting,
    ]
    head = "\n     ".join(origin(device)).replace("--", "- -")
    return (
        f"<!-- {head}\n     What an attribute can say: the friction of slow sliding at a fixed current. A general "
        f"actuator cannot hold, so there is none.\n     Not in it: {', '.join(left)}. A current that changes needs "
        f"{name}_mujoco.h, or mrwarp.mujoco.Brake. -->\n"
        f"<mujocoinclude>\n"
        f'  <option timestep="{device.dt:g}" ls_iterations="{brake_constraint.MIN_LS_ITERATIONS}"/>\n'
        "  <default>\n" + "\n".join(rows) + "\n  </default>\n</mujocoinclude>\n"
    )


def slow_friction(device: DeviceProgram, current: float) -> float:
    """Dry friction of slow sliding at a current [N·m]: eq. 14 at qd = 0 and the hysteresis' end, without D and C."""
    saturation = device.program.numbers["CURRENT_SATURATION_U"][0] or 0.0
    return device.params.bouc_wen.sliding_torque(_field(current, float(saturation)))


def _plain(text: str) -> str:
    return text.replace("·", "*").replace("*/", "* /").encode("ascii", "replace").decode()


def _field(current: float, saturation: float) -> float:
    return math.tanh(saturation * current) / saturation if saturation else current
