"""A quadruped in plain MuJoCo with brakes at its calves: their motors are off, and it stands on current alone.

Run: ``python examples/quadruped_on_brakes.py``
"""

import mujoco

import mrwarp.mujoco
from mrwarp.runtime import quiet_libraries

LEG = """
<body name="{name}_thigh" pos="{x} {y} 0">
  <joint name="{name}_thigh" axis="0 1 0" range="-3 3"/>
  <geom type="capsule" size="0.02" fromto="0 0 0 0 0 -0.21" mass="1"/>
  <body pos="0 0 -0.21">
    <joint name="{name}_calf" axis="0 1 0" range="-3 0"/>
    <geom type="capsule" size="0.015" fromto="0 0 0 0 0 -0.21" mass="0.2"/>
  </body>
</body>"""
ROBOT = """
<mujoco>
  <compiler angle="radian"/>
  <option timestep="0.002"/>
  <default><joint damping="0.1" armature="0.01"/></default>
  <worldbody>
    <geom type="plane" size="5 5 1"/>
    <body pos="0 0 0.275"><freejoint/><geom type="box" size="0.2 0.1 0.05" mass="7"/>{legs}</body>
  </worldbody>
  <actuator>{motors}</actuator>
</mujoco>"""
LEGS = {"FL": (0.18, 0.12), "FR": (0.18, -0.12), "RL": (-0.18, 0.12), "RR": (-0.18, -0.12)}
MOTOR = '<position joint="{name}_thigh" kp="200" kv="2"/>'


def trunk_height(current: float) -> float:
    """Height of the trunk [m] two seconds after the calves' motors were switched off."""
    legs = "".join(LEG.format(name=name, x=x, y=y) for name, (x, y) in LEGS.items())
    model = mujoco.MjModel.from_xml_string(
        ROBOT.format(legs=legs, motors="".join(MOTOR.format(name=name) for name in LEGS))
    )
    data = mujoco.MjData(model)
    brakes = [mrwarp.mujoco.Brake(model, data, f"{name}_calf") for name in LEGS]  # the paper's device
    data.qpos[7:], data.ctrl[:] = [0.9, -1.8] * len(LEGS), 0.9
    for _ in range(1000):
        for brake in brakes:
            brake.step(current)
        mujoco.mj_step(model, data)
    return float(data.qpos[2])


if __name__ == "__main__":
    quiet_libraries(gpu=False, networks=False)
    for current in (0.0, 0.25, 0.5, 1.0):
        print(f"{current:4.2f} A: the trunk is {trunk_height(current):.3f} m high after 2 s")
