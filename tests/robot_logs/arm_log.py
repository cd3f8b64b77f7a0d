"""A small arm and logs of it, simulated by plain MuJoCo at 0.25 ms: a truth that shares no code with the replays."""

import json
from collections.abc import Callable
from pathlib import Path

import mujoco
import numpy as np

ARM = """<mujoco model="arm">
 <compiler angle="radian"/>
 <default><geom contype="0" conaffinity="0"/></default>
 <worldbody><body name="upper" pos="0 0 0.5">
  <joint name="shoulder" axis="0 1 0" damping="0.02" frictionloss="0.1" armature="0.005"/>
  <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25" mass="0.8"/>
  <body name="lower" pos="0 0 -0.25">
   <joint name="elbow" axis="0 1 0" damping="0.02" frictionloss="0.1" armature="0.005"/>
   <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.25" mass="0.5"/>
  </body></body></worldbody>
</mujoco>"""

JOINTS = ("shoulder", "elbow")
KP, KD, DT, H = 12.0, 0.4, 0.005, 0.00025


def arm_log(
    folder: Path,
    *,
    seconds: float = 12.0,
    seed: int = 0,
    change: Callable[[mujoco.MjModel], None] | None = None,
    kp: float = KP,
    late: float = 0.0,
    offset: float = 0.0,
    extra: Callable[[float, np.ndarray, np.ndarray], np.ndarray] | None = None,
) -> Path:
    """Write ``arm.xml`` and a log of two chirps with steps; what the arguments change, the robot's file does not say.

    Args:
        folder: Made if it is not there.
        seconds: Length of each of two runs.
        seed: Of noise and motion.
        change: Of the truth's model.
        kp: Gain of the truth [N·m/rad]; the log says :data:`KP`.
        late: Delay of the commands [s].
        offset: Of the elbow's encoder [rad].
        extra: Torque beside the drives, by time, angles, speeds.
    """
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "arm.xml").write_text(ARM)
    gains = {"kp": dict.fromkeys(JOINTS, KP), "kd": dict.fromkeys(JOINTS, KD)}
    header = {"robot": "arm.xml", "base": "fixed", **gains, "tau_is": "none"}
    (folder / "log.json").write_text(json.dumps(header))
    rng = np.random.default_rng(seed)
    for run in range(2):
        model = mujoco.MjModel.from_xml_string(ARM)
        model.opt.timestep, model.opt.cone = H, mujoco.mjtCone.mjCONE_ELLIPTIC
        model.dof_solref[:], model.dof_solimp[:] = (0.005, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)  # it sticks
        if change is not None:
            change(model)
        data, phase = mujoco.MjData(model), rng.uniform(0.0, 6.0, 2)
        targets, rows, held = [np.zeros(2)], [], np.zeros(2)
        for k in range(round(seconds / DT)):
            t = k * DT
            wave = 0.5 * np.sin(phase + 2.0 * np.pi * (0.2 + 0.12 * t) * t)
            target = wave + 0.3 * np.array([int(0.4 * t) % 2, int(0.6 * t + 0.5) % 2])
            seen = data.qpos + [0.0, offset]
            rows.append([t, *(seen + rng.normal(0.0, 2e-4, 2)), *(data.qvel + rng.normal(0.0, 0.01, 2)), *target])
            targets.append(target)
            for n in range(round(DT / H)):
                age = t + n * H - late
                held = targets[max(0, min(int(np.floor(age / DT + 1e-9)) + 1, len(targets) - 1))] if age >= 0 else held
                data.qfrc_applied[:] = kp * (held - data.qpos - [0.0, offset]) - KD * data.qvel
                if extra is not None:
                    data.qfrc_applied[:] += extra(t + n * H, data.qpos, data.qvel)
                mujoco.mj_step(model, data)
        names = ["t", *(f"{c}.{j}" for c in ("q", "qd", "q_des") for j in JOINTS)]
        lines = [",".join(names), *(",".join(f"{x:.7g}" for x in row) for row in rows)]
        (folder / f"run{run}.csv").write_text("\n".join(lines) + "\n")
    return folder
