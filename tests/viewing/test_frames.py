"""Frames: copies of the simulator's own numbers, taken at the right instant."""

from typing import Any

import numpy as np
import pytest
import torch

from mrwarp.env.cfg import TaskCfg
from mrwarp.trials.walking import make_env
from mrwarp.viewing.frames import FrameReader, Frames, Gate


def test_frames_equal_the_environment(walk: Any) -> None:
    """Height, torques, ledger and gates are the environment's bits; the forward velocity its own within float32."""
    for t, now in enumerate(walk.truth):
        np.testing.assert_array_equal(walk.frames.qpos[t, :, 2].astype(np.float32), now["height"])
        np.testing.assert_array_equal(walk.frames.tau_motor[t], now["tau_motor"])
        np.testing.assert_array_equal(walk.frames.ledger[t], now["ledger"])
        np.testing.assert_array_equal(walk.frames.gate[t] == Gate.DYNAMIC, now["m_dyn"] == 1.0)
        np.testing.assert_array_equal(walk.frames.gate[t] == Gate.HOLD, now["m_hold"] == 1.0)
        np.testing.assert_allclose(walk.frames.v_x[t], now["v_x"], atol=1e-5)
        np.testing.assert_allclose(np.linalg.norm(walk.frames.foot_force[t], axis=-1), now["f_foot"], rtol=1e-5)
    assert set(np.unique(walk.frames.gate)) == {Gate.OFF, Gate.DYNAMIC, Gate.HOLD}


def test_frames_do_not_change_afterwards(walk: Any) -> None:
    """A frame is a copy: stepping on leaves it as it is."""
    reader = FrameReader(walk.env.robot, [1, 3])
    frame = reader.read(0.0)
    before = {name: value.copy() for name, value in vars(frame).items()}
    walk.env.step(torch.ones(4, 12))
    for name, value in vars(frame).items():
        np.testing.assert_array_equal(value, before[name])
    assert np.isnan(frame.v_x_command).all() and frame.qpos.shape[1] == 2


def test_standing_robot_is_carried_by_its_feet() -> None:
    """At rest the ground pushes the feet up with the robot's weight: m*g within 1 %, and hardly sideways."""
    env = make_env(TaskCfg(num_envs=1), 1, seed=0)
    for _ in range(200):
        env.step(torch.zeros(1, 12))
    force = FrameReader(env.robot, [0]).read(4.0).foot_force[0, 0].sum(axis=0)
    model = env.sim.scene.model
    weight = float(model.body_mass.sum()) * 9.81
    assert force[2] == pytest.approx(weight, rel=0.01)
    assert np.abs(force[:2]).max() < 0.02 * weight


def test_join_and_slice(walk: Any) -> None:
    """Joining the pieces of frames gives the frames again."""
    frames = walk.frames
    again = Frames.join([frames[:7], frames[7:8], frames[8:]])
    assert len(again) == len(frames) == 60
    for name, value in vars(frames).items():
        np.testing.assert_array_equal(getattr(again, name), value)


@pytest.mark.parametrize("shown", [[], [-1], [0, 4]])
def test_reader_refuses_environments_that_are_not_there(walk: Any, shown: list[int]) -> None:
    """No environment, a negative one and one too many."""
    with pytest.raises(ValueError, match=r"must lie in 0\.\.3"):
        FrameReader(walk.env.robot, shown)
