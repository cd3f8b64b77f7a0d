"""The task's configuration: fresh objects, refusals with the value, derived times, and the variant for evaluation."""

from dataclasses import replace
from pathlib import Path

import pytest

from mrwarp.env.cfg import TaskCfg, make_play_cfg
from mrwarp.env.config.mdp_cfg import RandomizeCfg, make_randomize_cfg


def test_ground_randomises_friction_and_kicks_alone() -> None:
    """Mass, devices and gains are nominal; everything else is as with all."""
    ground, everything = make_randomize_cfg("ground"), make_randomize_cfg("all")
    assert ground is not None and everything == RandomizeCfg()
    assert (ground.added_mass, ground.mr_scale, ground.gain_scale) == ((0.0, 0.0), (1.0, 1.0), (1.0, 1.0))
    of_the_robot = {name: getattr(everything, name) for name in ("added_mass", "mr_scale", "gain_scale")}
    assert replace(ground, **of_the_robot) == everything


def test_a_learned_actuator_has_the_shipped_network_or_ones_own(monkeypatch: pytest.MonkeyPatch) -> None:
    """Nothing need be said of the shipped one; without one, the file is asked for."""
    assert TaskCfg().network is None
    assert Path(TaskCfg(actuator="lstm").network or "").name == "lstm.safetensors"
    assert TaskCfg(actuator="lstm", actuator_file="own.safetensors").network == "own.safetensors"
    monkeypatch.setattr("mrwarp.env.cfg.shipped_model", lambda kind: None)
    with pytest.raises(ValueError, match="'lstm' needs an actuator_file"):
        TaskCfg(actuator="lstm")


def test_cfg_times_are_the_papers() -> None:
    """Policy at 50 Hz (4 torque steps of 5 ms), episodes of 20 s = 1000 steps, gait clock 1.5 Hz."""
    cfg = TaskCfg()
    assert cfg.step_dt == pytest.approx(0.02, rel=1e-15)
    assert cfg.episode_steps == 1000
    assert cfg.gait_frequency == 1.5
    assert cfg.currents == (0.0, 0.5, 1.0, 1.5)


def test_play_cfg_differs_only_in_noise_randomisation_and_command_period() -> None:
    """Evaluation is the same task with the nominal robot, no noise and commands held."""
    cfg = TaskCfg(seed=3, payload=3, sal=False)
    play = make_play_cfg(cfg)
    assert play.noise is None and play.randomize is None and play.commands.period == float("inf")
    commands = replace(play.commands, period=cfg.commands.period)
    assert replace(play, noise=cfg.noise, randomize=cfg.randomize, commands=commands) == cfg
