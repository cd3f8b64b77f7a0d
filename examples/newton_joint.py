"""The joint in Newton: four pendulums fall from level, each with a brake and another current.

Run: ``python examples/newton_joint.py``
"""

from typing import Any

import newton
import numpy as np
import warp as wp

import mrwarp
from mrwarp.actuator.newton_drive import apply_brake_bounds
from mrwarp.runtime import quiet_libraries

CURRENTS = (0.0, 0.5, 1.0, 1.5)
DT = 0.005


def main(seconds: float = 0.5) -> np.ndarray:
    """Let them go: without current one falls, the others are held. Returns their angles [rad]."""
    builder = newton.ModelBuilder()
    for _ in CURRENTS:
        builder.begin_world()
        arm = builder.add_link(mass=2.0, inertia=wp.mat33(0.02, 0.0, 0.0, 0.0, 0.02, 0.0, 0.0, 0.0, 0.02))
        pin = wp.transform((-0.2, 0.0, 0.0), wp.quat_identity())  # 0.2 m from the centre of mass
        joint = builder.add_joint_revolute(parent=-1, child=arm, axis=(0.0, 1.0, 0.0), child_xform=pin)
        builder.add_articulation([joint])
        # the paper's device; or mrwarp.DriveMR.from_model("model.json", builder, index=...)
        mrwarp.DriveMR.from_model("paper", builder, index=builder.joint_qd_start[joint], coupling="constraint")
        builder.end_world()
    model = builder.finalize()

    solver = newton.solvers.SolverMuJoCo(model)
    state: Any = model.state()
    after = model.state()
    control: Any = model.control()  # the drive adds its inputs to it
    (actuator,) = model.actuators
    now, then = actuator.state(), actuator.state()
    control.mr_foot_load = None  # no feet: no gates, the coil gets what mr_current asks for
    control.mr_current.assign(CURRENTS)
    for _ in range(round(seconds / DT)):
        control.joint_f.zero_()
        actuator.step(state, control, now, then, dt=DT)
        now, then = then, now
        apply_brake_bounds(solver, actuator, DT)  # the device is a dry friction of the solver: it sticks
        solver.step(state, after, control, None, DT)
        state, after = after, state
    angle = state.joint_q.numpy()
    for amps, swung in zip(CURRENTS, np.degrees(angle), strict=True):
        print(f"{amps:.1f} A: {swung:6.1f} deg after {seconds} s")
    return angle


if __name__ == "__main__":
    quiet_libraries(gpu=False)
    main()
