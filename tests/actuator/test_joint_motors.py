"""Motors of a MuJoCo model's joint, of all its actuators together."""

import math

import mujoco
import pytest

from mrwarp.actuator.joint_motors import rotor, torque_range


def test_what_a_joints_motors_give_is_the_sum_of_all_of_them() -> None:
    """Through gears of either sign, within the joint's own range, as MuJoCo gives it."""
    model = mujoco.MjModel.from_xml_string(
        '<mujoco><worldbody><body><joint name="a" actuatorfrcrange="-9 30"/><geom size="0.1"/><body>'
        '<joint name="b" axis="0 1 0"/><geom size="0.1"/></body></body></worldbody><actuator>'
        '<motor joint="a" gear="-3" ctrlrange="-2 4"/><motor joint="a" gear="2" forcerange="-1 5" armature="0.01"/>'
        '<position joint="b" kp="50" ctrlrange="-1 1"/></actuator></mujoco>'
    )
    limits = torque_range(model, 0)
    assert limits == (pytest.approx(-9.0), pytest.approx(16.0)) and rotor(model, 0) == pytest.approx(0.04)
    assert torque_range(model, 1) == (-math.inf, math.inf)  # a servo's range is that of its angle
    data = mujoco.MjData(model)
    for end, commands in zip(limits, ((4.0, -99.0), (-2.0, 99.0)), strict=True):
        data.ctrl[:2] = commands
        mujoco.mj_forward(model, data)
        assert data.qfrc_actuator[0] == pytest.approx(end)
