"""A brake in plain MuJoCo: a pendulum that swings, is caught, and hangs still at an angle.

Run: ``python examples/mujoco_pendulum.py``
"""

import mujoco
import numpy as np

import mrwarp.mujoco
from mrwarp.runtime import quiet_libraries

PENDULUM = """
<mujoco>
  <option timestep="0.002"/>
  <worldbody>
    <body>
      <joint name="hinge" axis="0 1 0"/>
      <geom type="capsule" size="0.02" fromto="0 0 0 0.4 0 0" mass="1"/>
    </body>
  </worldbody>
</mujoco>
"""


def main() -> None:
    """Release the pendulum level; after half a second give the coil 1 A."""
    model = mujoco.MjModel.from_xml_string(PENDULUM)
    data = mujoco.MjData(model)
    brake = mrwarp.mujoco.Brake(model, data, "hinge")  # the paper's device; or a model.json as the fourth argument
    for k in range(1500):
        brake.step(current=1.0 if k >= 250 else 0.0)
        mujoco.mj_step(model, data)
        if k % 250 == 249:
            angle, speed = np.degrees(data.qpos[0]), data.qvel[0]
            print(f"{data.time:.1f} s: {angle:6.1f} deg, {speed:+.1e} rad/s, the brake may bear {brake.bound:5.2f} N·m")


if __name__ == "__main__":
    quiet_libraries(gpu=False, networks=False)
    main()
