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
        extra: Torque in addition to the drives, by time, angles, speeds.
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


THREE = """<mujoco><compiler angle="radian"/><default><geom contype="0" conaffinity="0"/></default><worldbody>
 <body name="base" pos="0 0 0.3"><geom type="cylinder" size="0.1 0.05" mass="{mb}"/>
 <body name="l1" pos="0 0 0.05"><joint name="j1" axis="0 0 1" armature="{a1}" damping="0.2" frictionloss="{f}"/>
  <geom type="capsule" size="0.04" fromto="0 0 0 0 0 0.15" mass="{m1}"/>
 <body name="l2" pos="0 0 0.15"><joint name="j2" axis="0 1 0" armature="{a2}" damping="0.2" frictionloss="{f}"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 {x2} 0 {l2}" mass="{m2}"/>
 <body name="l3" pos="{x2} 0 {l2}"><joint name="j3" axis="0 1 0" armature="{a3}" damping="0.1" frictionloss="{f3}"/>
  <geom type="capsule" size="0.03" fromto="0 0 0 {l3} 0 0" mass="{m3}"/>
 </body></body></body></body></worldbody>
 <actuator><position joint="j1" kp="{k1}" kv="{d1}" forcerange="-{t1} {t1}"/>
  <position joint="j2" kp="{k2}" kv="{d2}" forcerange="-{t2} {t2}"/>
  <position joint="j3" kp="{k3}" kv="{d3}" forcerange="-{t3} {t3}"/></actuator></mujoco>"""
HEAVY = {
    "mb": 4, "a1": 0.05, "a2": 0.05, "a3": 0.03, "f": 0.2, "f3": 0.1, "m1": 1.5, "m2": 1.5, "m3": 1.0, "x2": 0,
    "l2": 0.3, "l3": 0.25, "k1": 120, "k2": 150, "k3": 60, "d1": 6, "d2": 8, "d3": 3, "t1": 60, "t2": 80, "t3": 40,
}  # fmt: skip


def heavy_arm(folder: Path) -> Path:
    """Write an arm of three joints on a base of its own, for virtual robots."""
    path = folder / "heavy.xml"
    path.write_text(THREE.format(**HEAVY))
    return path


def drawn_arm(folder: Path, seed: int) -> Path:
    """Write an arm as :func:`heavy_arm`'s whose masses, lengths, rotors, frictions and gains are drawn."""
    rng = np.random.default_rng(seed)

    def drawn(low: float, high: float) -> float:
        return round(float(np.exp(rng.uniform(np.log(low), np.log(high)))), 4)

    numbers = {"m2": drawn(0.8, 3.0), "m3": drawn(0.5, 2.0), "l2": drawn(0.2, 0.4), "l3": drawn(0.15, 0.35)}
    gains = {"k1": drawn(80.0, 250.0), "k2": drawn(100.0, 300.0), "k3": drawn(40.0, 120.0)}
    numbers |= gains | {name.replace("k", "d"): round(0.05 * gain, 2) for name, gain in gains.items()}
    numbers |= {"mb": drawn(2.0, 8.0), "m1": drawn(1.0, 3.0), "x2": round(float(rng.uniform(-0.1, 0.1)), 3)}
    numbers |= {"a1": drawn(0.02, 0.1), "a2": drawn(0.02, 0.1), "a3": drawn(0.01, 0.05), "f": drawn(0.05, 0.4)}
    numbers |= {"f3": numbers["f"], "t1": 90, "t2": 120, "t3": 60}
    path = folder / "drawn.xml"
    path.write_text(THREE.format(**numbers))
    return path


LINKS = ((0.1, 1.5), (0.3, 1.8), (0.25, 1.2), (0.1, 0.5), (0.1, 0.4), (0.08, 0.3))
"""Length [m] and mass [kg] of an arm of six joints."""

GAINS = ((120.0, 150.0, 100.0, 40.0, 30.0, 20.0), (4.0, 5.0, 3.0, 1.0, 0.8, 0.5))


def six_joint_log(folder: Path, *, seconds: float = 20.0, friction: float = 0.8, seed: int = 0) -> Path:
    """Write ``arm.xml`` and a log of two runs of an arm of six joints; its third has more dry friction than described.

    Args:
        folder: Made if it is not there.
        seconds: Length of each run.
        friction: What the description lacks at ``j2`` [N·m].
        seed: Of noise and motion.
    """
    body, joints = "", [f"j{k}" for k in range(6)]
    for k, (length, mass) in reversed(list(enumerate(LINKS))):
        axis = ("0 0 1", "0 1 0", "0 1 0", "1 0 0", "0 1 0", "1 0 0")[k]
        body = (
            f'<body name="link{k}" pos="0 0 {LINKS[k - 1][0] if k else 0.05}"><joint name="j{k}" axis="{axis}" '
            f'damping="0.1" frictionloss="{0.3 if k < 3 else 0.1}" armature="{0.05 if k < 3 else 0.01}"/>'
            f'<geom type="capsule" size="0.03" fromto="0 0 0 0.01 0.005 {length}" mass="{mass}"/>{body}</body>'
        )
    folder.mkdir(parents=True, exist_ok=True)
    geoms = '<default><geom contype="0" conaffinity="0"/></default>'
    (folder / "arm.xml").write_text(f"<mujoco>{geoms}<worldbody>{body}</worldbody></mujoco>")
    kp, kd = (dict(zip(joints, gains, strict=True)) for gains in GAINS)
    header = {"robot": "arm.xml", "base": "fixed", "kp": kp, "kd": kd, "tau_is": "none"}
    (folder / "log.json").write_text(json.dumps(header))
    rng, home, rate = np.random.default_rng(seed), np.array([0.0, 0.5, 0.8, 0.0, 0.3, 0.0]), 0.15 + 0.06 * np.arange(6)
    for run in range(2):
        model = mujoco.MjModel.from_xml_path(str(folder / "arm.xml"))
        model.opt.timestep = 2.0 * H
        model.dof_solref[:], model.dof_solimp[:] = (0.005, 1.0), (0.9999, 0.9999, 0.001, 0.5, 2.0)
        model.dof_frictionloss[2] += friction
        data, phase, rows = mujoco.MjData(model), rng.uniform(0.0, 6.0, 6), []
        data.qpos[:] = home
        for k in range(round(seconds / DT)):
            t = k * DT
            steps = 0.15 * np.array([int(0.3 * t * (1.0 + 0.1 * i)) % 2 for i in range(6)])
            target = home + 0.35 * np.sin(phase + np.pi * (rate + 0.05 * t) * t) + steps
            seen = data.qpos + rng.normal(0.0, 2e-4, 6), data.qvel + rng.normal(0.0, 0.01, 6)
            rows.append([t, *seen[0], *seen[1], *target])
            for _ in range(round(DT / model.opt.timestep)):
                data.qfrc_applied[:] = GAINS[0] * (target - data.qpos) - GAINS[1] * data.qvel
                mujoco.mj_step(model, data)
        names = ["t", *(f"{c}.{j}" for c in ("q", "qd", "q_des") for j in joints)]
        np.savetxt(folder / f"run{run}.csv", rows, "%.7g", ",", header=",".join(names), comments="")
    return folder
