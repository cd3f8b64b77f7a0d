"""The step of eq. 15: exact in every command that simulates, the paper's where it is asked for, or was trained with."""

from typing import Any

import pytest

from mrwarp.actuator.actuator_cfg import MrActuatorCfg
from mrwarp.actuator.newton_drive import DriveMR
from mrwarp.commands.run_play import Play
from mrwarp.commands.run_walk import Walk
from mrwarp.enums import AWARE, PAYING, PLANTS, PUBLIC, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.nn import network_file
from mrwarp.options.command_line import CommandLine, parse, values
from mrwarp.options.command_table import COMMANDS, Command
from mrwarp.resources import DEFAULT_POLICY, shipped_model
from mrwarp.rl.policy_file import read_policy
from paper.reproduce.disturbance import push_rule
from paper.reproduce.settings import Settings
from paper.study.plan import plant_cfg
from paper.study.rollouts import STEPS, EvaluationCfg, step_plant


@pytest.mark.parametrize("name", ["train", "impact", "walk", "mission", "play"])
def test_every_command_that_simulates_offers_both(name: str) -> None:
    """One option of one name; nothing typed is the exact step, in ``play`` what the policy's task says."""
    command = COMMANDS[name]
    assert isinstance(command, Command)

    def read(*words: str) -> Any:
        return values(parse(command.load(), words, name))

    needed = ["--agent", "zero"] if name == "play" else []
    asked = {step: read(*needed, "--z-step", step)["z_step"] for step in ("euler", "exact")}
    assert asked == {"euler": ZStep.EULER, "exact": ZStep.EXACT}
    assert read(*needed)["z_step"] is ZStep.EXACT


def test_nothing_chosen_is_the_exact_step() -> None:
    """Actuator, task, drive; a walk's task is what its option says."""
    assert MrActuatorCfg().z_step is TaskCfg().z_step is ZStep.EXACT
    assert DriveMR.resolve_arguments({})["z_step"] is ZStep.EXACT
    assert DriveMR.resolve_arguments({"z_step": "euler"})["z_step"] is ZStep.EULER
    for step in ZStep:
        assert Walk(z_step=step).env_cfg().z_step is step


def test_the_paper_is_reproduced_with_its_own_step() -> None:
    """Studies and the report, for any plant; and the shipped residual network, which corrects that step."""
    for plant in (*PLANTS, PUBLIC, *PAYING):
        assert plant_cfg(plant).z_step is ZStep.EULER, plant
    reading = push_rule.LITERAL
    pushed = push_rule.config(reading, Settings(), (reading.variant(0.0),), 0.3)
    assert pushed.env.z_step is ZStep.EULER
    for step in STEPS:
        env, _ = step_plant(step, EvaluationCfg(threads=1))
        assert env.actuator == "none" or env.z_step is ZStep.EULER
    shipped = shipped_model(AWARE)
    assert shipped is not None and network_file.load(shipped).z_step == "euler"


def test_a_policy_plays_with_its_own_step_on_its_own_devices() -> None:
    """The shipped one was trained with Euler's; files that name none too; other devices take the exact one."""
    task = read_policy(DEFAULT_POLICY)[1]["task"]
    assert task["z_step"] == "euler"

    def step(task: dict[str, Any], *words: str) -> ZStep:
        argv = ("--policy", str(DEFAULT_POLICY), *words)
        return parse(Play, argv, "play")._cfg(CommandLine("mrwarp play", argv), task).z_step

    assert step(task) is ZStep.EULER
    assert step({name: value for name, value in task.items() if name != "z_step"}) is ZStep.EULER
    assert step({**task, "z_step": "exact"}) is step({}) is ZStep.EXACT
    own = ("--model", "own.json")
    assert step(task, *own) is ZStep.EXACT
    assert step({**task, "model": "own.json"}, *own) is ZStep.EULER
    assert step(task, *own, "--z-step", "euler") is ZStep.EULER
