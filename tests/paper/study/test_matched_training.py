"""Trainings of the studies: resumed to the same policy, shared by processes, collected with a record."""

import json
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from matplotlib.axes import Axes

from mrwarp.cli import main
from mrwarp.enums import Coupling
from mrwarp.env.cfg import make_play_cfg
from mrwarp.env.config.mdp_cfg import RandomizeCfg, RewardCfg, make_randomize_cfg
from mrwarp.env.vec_env import WalkEnv
from mrwarp.paper import ROBOTS
from mrwarp.resources import ENERGY
from mrwarp.rl.policy import POLICIES, OnnxPolicy, PolicyError
from mrwarp.rl.ppo_cfg import PpoCfg
from mrwarp.run_dir import claim
from mrwarp.usd.robot import PUBLIC_GAINS
from paper.study import matched_training, plan
from paper.study.matched_training import RunError, collect, failed_conditions, train
from paper.study.plan import (
    AWARE,
    CONVENTIONAL,
    EXPLICIT,
    HEIGHT,
    PAYING,
    PLANTS,
    POWER_PRICE,
    PUBLIC,
    STUDY,
    TILT,
    StudyCfg,
    name,
    plant_cfg,
    policy_file,
    record_file,
    start_file,
)
from tests.messages import Refused

pytestmark = pytest.mark.usefixtures("short_gate_of_module")
CFG = StudyCfg(num_envs=4, iterations=2, terrain="flat", seeds=(0,), plants=(CONVENTIONAL, "bouc_wen"))


@pytest.fixture(scope="module")
def trained(short_gate_of_module: None, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Runs of :data:`CFG`."""
    folder = tmp_path_factory.mktemp("trained")
    assert train(CFG, folder, report=lambda line: None)
    return folder


@pytest.fixture
def runs(trained: Path, tmp_path: Path) -> Path:
    """A copy of the trained runs, to be changed."""
    return shutil.copytree(trained, tmp_path / "runs")


def test_plants_differ_in_the_device_alone() -> None:
    """Commands, noise, randomisation, rewards, terrain and rates are the same objects' values for all plants."""
    cfgs = [plant_cfg(plant, terrain="rough") for plant in PLANTS]
    for shared in ("commands", "noise", "randomize", "rewards", "terrain", "action_scale", "gait_frequency"):
        assert len({repr(getattr(cfg, shared)) for cfg in cfgs}) == 1, shared
    assert cfgs[0].randomize == make_randomize_cfg("ground")
    assert [cfg.robot for cfg in cfgs] == ["go1"] + ["mr_go"] * 4
    assert [cfg.actuator for cfg in cfgs] == ["none", "pg_rlstm", "mlp", "bouc_wen", "lstm"]


def test_robots_of_tables_6_and_7_pay_alike_for_power_and_carry_loads() -> None:
    """Rewards, commands, noise and randomisation are the same; SAL is on for MR_Go-SAL alone, at 1.5 A."""
    cfgs = [plant_cfg(robot, randomize="all") for robot in ROBOTS]
    for shared in ("commands", "noise", "randomize", "rewards", "currents", "action_scale", "gait_frequency"):
        assert len({repr(getattr(cfg, shared)) for cfg in cfgs}) == 1, shared
    assert cfgs[0].rewards == RewardCfg(weights={"power": -POWER_PRICE, "height": HEIGHT, "tilt": TILT})
    assert cfgs[0].currents == (1.5,)
    assert cfgs[0].randomize == RandomizeCfg(added_mass=(-0.5, 3.5))
    assert [(cfg.robot, cfg.actuator, cfg.sal) for cfg in cfgs] == [
        ("go1", "none", False),
        ("mr_go", "bouc_wen", False),
        ("mr_go", "bouc_wen", True),
    ]
    assert plant_cfg("go1", randomize="none").randomize is None
    free = plant_cfg("go1", randomize="all", power_price=0.0)
    assert free == replace(cfgs[0], rewards=cfgs[0].rewards.weighing(power=0.0))
    assert plant_cfg(AWARE, power_price=1.0) == plant_cfg(AWARE)
    explicit = plant_cfg(EXPLICIT, randomize="all")
    assert explicit.coupling is Coupling.EXPLICIT
    assert replace(explicit, coupling=Coupling.CONSTRAINT) == cfgs[2]


def test_robots_that_pay_name_their_price(tmp_path: Path, refused: Refused) -> None:
    """In the record's command and task; another price is another training."""
    options = ["--plants", "go1", "--seeds", "0", "--num-envs", "4", "--iterations", "1", "--runs", str(tmp_path / "r")]
    out = ["--out", str(tmp_path / "policies")]
    assert main(["study", "train", *options, "--power-price", "0.02"]) == 0
    assert "trained with rewards.power = -0.02 (asked: -0.002)" in refused("study", "collect", *options, *out)
    assert main(["study", "collect", *options, *out, "--power-price", "0.02"]) == 0
    record = json.loads(record_file(tmp_path / "policies", "go1", 0).read_text())
    assert record["command"].endswith("--randomize ground --power-price 0.02 --desired-kl 0.04 --entropy 0.003")
    assert record["task"]["rewards"]["power"] == -0.02


def test_public_gains_are_those_of_every_motor() -> None:
    """The aware plant with another Kp and Kd: in motors and devices, of the trained and of the judged robot."""
    cfg = plant_cfg(PUBLIC, num_envs=2, randomize="none")
    aware = plant_cfg(AWARE, num_envs=2, randomize="none")
    assert cfg == replace(aware, gains=PUBLIC_GAINS, rewards=aware.rewards.weighing(height=HEIGHT))
    for env in (WalkEnv(cfg), WalkEnv(make_play_cfg(cfg))):
        kp, kd = (env.view(array) for array in (env.actuator.kp, env.actuator.kd))
        assert bool((kp == PUBLIC_GAINS[0]).all()) and bool((kd == PUBLIC_GAINS[1]).all())
        for gain_name, gain in (("kp_base", PUBLIC_GAINS[0]), ("kd", PUBLIC_GAINS[1]), ("kp_low", 5.0)):
            assert bool((env.view(env.actuator.param(gain_name)) == gain).all()), gain_name


def test_trainings_begin_with_the_policies_of_a_folder(tmp_path: Path) -> None:
    """Rough ground from the shipped policy of the plant and seed, resumed without it; the record names it."""
    cfg = replace(CFG, terrain="rough", plants=(CONVENTIONAL,), seeds=(1,), start_from=STUDY)
    assert train(replace(cfg, iterations=1), tmp_path / "runs", report=lambda line: None)
    assert train(cfg, tmp_path / "runs", report=lambda line: None)
    collect(cfg, tmp_path / "runs", tmp_path / "policies")
    record = json.loads(record_file(tmp_path / "policies", CONVENTIONAL, 1).read_text())
    assert record["started_from"]["file"] == str(policy_file(STUDY, CONVENTIONAL, 1))
    assert record["started_from"]["seed"] == 1 and record["task"]["terrain"] == "rough"
    assert record["command"].endswith(f"--coupling explicit --desired-kl 0.04 --entropy 0.003 --start-from {STUDY}")
    for other in (None, tmp_path / "policies"):
        with pytest.raises(RunError, match=r"started from .*policies/study/conventional_seed1\.onnx \(update 800\)"):
            train(replace(cfg, start_from=other), tmp_path / "runs", report=lambda line: None)
    begins = {robot: start_file(STUDY, robot, 1).name for robot in PAYING}
    assert begins == {"go1": "conventional_seed1.onnx", **dict.fromkeys(list(begins)[1:], "bouc_wen_seed1.onnx")}
    assert start_file(ENERGY, "mr_go", 1) == policy_file(ENERGY, "mr_go", 1), "its own comes first"
    with pytest.raises(PolicyError, match="no such policy"):
        train(replace(cfg, start_from=tmp_path), tmp_path / "others", report=lambda line: None)
    assert not (tmp_path / "others").exists()


def test_trainings_begin_with_the_runs_of_a_folder(tmp_path: Path) -> None:
    """Of a run the whole checkpoint is taken, critic and noise too, by more robots that learn in smaller steps."""
    cfg = replace(CFG, plants=("bouc_wen",), iterations=1)
    assert train(cfg, tmp_path / "first", report=lambda line: None)
    settled = replace(cfg, num_envs=6, start_from=tmp_path / "first", learning=PpoCfg(desired_kl=0.01, entropy=0.0))
    assert train(settled, tmp_path / "settled", report=lambda line: None)
    collect(settled, tmp_path / "settled", tmp_path / "policies")
    record = json.loads(record_file(tmp_path / "policies", "bouc_wen", 0).read_text())
    origin = tmp_path / "first" / name("bouc_wen", 0) / "checkpoint.pt"
    assert record["started_from"]["file"] == str(origin) and record["started_from"]["iteration"] == 1
    assert (
        record["learning"] == {"desired_kl": 0.01, "entropy": 0.0, "symmetry": True} and record["task"]["num_envs"] == 6
    )
    assert record["command"].endswith(f"--desired-kl 0.01 --entropy 0 --start-from {tmp_path / 'first'}")


@pytest.mark.usefixtures("drawn")
def test_training_in_two_goes_gives_the_policy_of_one_and_a_record(runs: Path, tmp_path: Path) -> None:
    """One update, then on to two, equals two at once; the record says how it was made and holds the curve."""
    once, twice = tmp_path / "once", tmp_path / "twice"
    runs.rename(once)
    lines: list[str] = []
    assert train(replace(CFG, iterations=1), twice, report=lines.append)
    assert train(CFG, twice, report=lines.append)
    written = [collect(CFG, folder, tmp_path / f"{folder.name}_policies") for folder in (once, twice)]
    obs = torch.linspace(-1.0, 1.0, 94).reshape(2, 47)
    for first, second in zip(*written, strict=True):
        assert torch.equal(OnnxPolicy(first)(obs), OnnxPolicy(second)(obs))
    record = json.loads(record_file(tmp_path / "once_policies", "bouc_wen", 0).read_text())
    assert record["command"] == (
        "mrwarp study train --plants bouc_wen --seeds 0 --num-envs 4 --iterations 2 --terrain flat --randomize ground "
        "--coupling explicit --desired-kl 0.04 --entropy 0.003"
    )
    assert (record["iterations"], record["environment_steps"], record["task"]["terrain"]) == (2, 2 * 24 * 4, "flat")
    assert record["curve"]["iteration"] == [1.0, 2.0] and len(record["curve"]["reward"]) == 2
    lines.clear()
    assert train(CFG, once, report=lines.append)
    assert lines == ["conventional_seed0: finished", "bouc_wen_seed0: finished"]

    found = matched_training.figure5(tmp_path / "once_policies", plants=(CONVENTIONAL, "bouc_wen"), seeds=(0,))
    assert found["bouc_wen"].reward.tolist() == [record["curve"]["reward"]]
    np.testing.assert_array_equal(found["bouc_wen"].sd, 0.0)
    matched_training.plot(found, tmp_path / "fig5.png")
    assert (tmp_path / "fig5.png").stat().st_size > 5000


def test_runs_of_other_choices_are_neither_finished_nor_collected(
    runs: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], refused: Refused
) -> None:
    """Randomisation, ground, environments, updates and seed: exit code 2, one line, nothing written."""
    out = tmp_path / "out"
    options = ["--plants", CONVENTIONAL, "--seeds", "0", "--num-envs", "4", "--iterations", "2", "--runs", str(runs)]
    assert main(["study", "train", *options]) == 0
    before = sorted(runs.rglob("*"))
    for choice, text in (
        (["--randomize", "all"], "randomize.added_mass = [0.0, 0.0] (asked: [-0.5, 1.0])"),
        (["--randomize", "none"], "(asked: None)"),
        (["--terrain", "rough"], "terrain = 'flat' (asked: 'rough')"),
        (["--num-envs", "5"], "num_envs = 4 (asked: 5)"),
        (["--iterations", "1"], "iterations = 2 (asked: 1)"),
        (["--desired-kl", "0.01"], "desired_kl = 0.04 (asked: 0.01)"),
        (["--entropy", "0"], "entropy = 0.003 (asked: 0.0)"),
    ):
        for part in (["train"], ["collect", "--out", str(out)]):
            error = refused("study", *part, *options, *choice)
            assert f"{runs / name(CONVENTIONAL, 0)}: trained with " in error and text in error
            assert "--entropy 0.003' or name another --runs to train again" in error
    assert sorted(runs.rglob("*")) == before and not out.exists()
    (runs / name(CONVENTIONAL, 0)).rename(runs / name(CONVENTIONAL, 1))
    with pytest.raises(RunError, match=r"seed = 0 \(asked: 1\)"):
        collect(replace(CFG, plants=(CONVENTIONAL,), seeds=(1,)), runs, out)
    (runs / name(CONVENTIONAL, 1)).rename(runs / name(CONVENTIONAL, 0))
    capsys.readouterr()
    assert main(["study", "collect", *options, "--out", str(out)]) == 0
    failed = failed_conditions(record_file(out, CONVENTIONAL, 0))
    assert failed and f"did not pass the walking gate: {', '.join(failed)}" in capsys.readouterr().out
    assert sorted(path.name for path in out.iterdir()) == ["conventional_seed0.json", "conventional_seed0.onnx"]


def test_a_run_that_was_not_ended_is_compared_before_others_train(runs: Path, tmp_path: Path) -> None:
    """A checkpoint of another task in the second run, or of more updates: the first is not begun."""
    cfg, run = replace(CFG, plants=("bouc_wen",)), runs / name("bouc_wen", 0)
    shutil.rmtree(runs / name(CONVENTIONAL, 0))
    (run / "result.json").unlink()
    with pytest.raises(FileNotFoundError, match=r"not finished \(2 of 3 updates\)"):
        collect(replace(cfg, iterations=3), runs, tmp_path / "policies")
    for other, text in (
        (replace(CFG, randomize="none"), r"trained with randomize = .* \(asked: None\)"),
        (replace(CFG, iterations=1), r"trained with iterations = 2 \(asked: 1\)"),
        (replace(CFG, start_from=STUDY), "started from networks as drawn, asked for is .*bouc_wen_seed0.onnx"),
    ):
        with pytest.raises(RunError, match=text):
            train(other, runs, report=lambda line: None)
    assert [path.name for path in runs.iterdir()] == [run.name]


def test_an_interrupted_training_is_not_finished(runs: Path, tmp_path: Path) -> None:
    """Even with the updates asked for: its gate was not checked; the same command does it."""
    cfg = replace(CFG, plants=(CONVENTIONAL,))
    result = runs / name(CONVENTIONAL, 0) / "result.json"
    content = json.loads(result.read_text())
    result.write_text(json.dumps({**content, "stopped": "interrupted", "gate": None}))
    with pytest.raises(FileNotFoundError, match=r"not finished \(2 of 2 updates\)"):
        collect(cfg, runs, tmp_path / "policies")
    assert train(cfg, runs, report=lambda line: None)
    assert json.loads(result.read_text())["gate"] is not None
    assert len(collect(cfg, runs, tmp_path / "policies")) == 1


def test_what_is_not_whole_is_not_collected(runs: Path, tmp_path: Path) -> None:
    """A training that was not begun, or whose policy is gone: the one before it is not written either."""
    (runs / name("bouc_wen", 0) / "policy.onnx").unlink()
    for folder, said in (
        (tmp_path / "none", r"conventional_seed0: not finished \(0 of 2 updates\)"),
        (runs, r"bouc_wen_seed0.*policy\.onnx"),
    ):
        with pytest.raises(FileNotFoundError, match=said):
            collect(CFG, folder, tmp_path / "policies")
    assert not (tmp_path / "policies").exists()


def test_a_record_ends_where_its_policy_does(runs: Path, tmp_path: Path) -> None:
    """A run that was collected while a longer training was under way: the checkpoint holds more updates."""
    cfg = replace(CFG, plants=(CONVENTIONAL,))
    long = shutil.copytree(runs, tmp_path / "long")
    assert train(replace(cfg, iterations=3), long, report=lambda line: None)
    (long / name(CONVENTIONAL, 0) / "checkpoint.pt").replace(runs / name(CONVENTIONAL, 0) / "checkpoint.pt")
    collect(cfg, runs, tmp_path / "policies")
    record = json.loads(record_file(tmp_path / "policies", CONVENTIONAL, 0).read_text())
    assert record["iterations"] == 2 and record["curve"]["iteration"] == [1.0, 2.0]


def test_more_curves_than_colours_are_all_drawn(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Nine plants: the colours begin again."""
    drawn, original = [], Axes.plot

    def spy(self: Axes, *args: Any, **kwargs: Any) -> Any:
        drawn.append(kwargs["label"])
        return original(self, *args, **kwargs)

    monkeypatch.setattr(Axes, "plot", spy)
    found = {plant: matched_training.Curve(update=np.arange(2.0), reward=np.zeros((1, 2))) for plant in plan.TRAINABLE}
    matched_training.plot(found, tmp_path / "fig5.png")
    assert len(drawn) == len(plan.TRAINABLE) > len(matched_training.COLOURS)


def test_policy_that_another_process_trains_is_left_out(tmp_path: Path) -> None:
    """Its folder is claimed: nothing is trained, and the work is not called finished."""
    run = tmp_path / name(CONVENTIONAL, 0)
    run.mkdir()
    lines: list[str] = []
    with claim(run):
        assert not train(replace(CFG, plants=(CONVENTIONAL,)), tmp_path, report=lines.append)
    assert "another run writes here" in lines[-1]
    assert list(run.iterdir()) == []


@pytest.mark.parametrize("text", ["", "[]", '{"iterations": 2}', "{"])
def test_a_damaged_result_is_named(tmp_path: Path, text: str) -> None:
    """By its file and with the remedy, before anything is trained or collected."""
    run = tmp_path / name(CONVENTIONAL, 0)
    run.mkdir()
    (run / "result.json").write_text(text)
    for act in (lambda: train(CFG, tmp_path), lambda: collect(CFG, tmp_path, tmp_path / "policies")):
        with pytest.raises(ValueError, match=r"conventional_seed0/result\.json: .*remove the folder to train again"):
            act()
    assert not (tmp_path / "policies").exists()


def test_record_that_cannot_be_used_is_named(tmp_path: Path) -> None:
    """Missing, damaged, and of another length."""
    with pytest.raises(RunError, match=r"conventional_seed0\.json: no such record"):
        matched_training.figure5(tmp_path, seeds=(0,))
    for seed, text in ((0, "{}"), (1, '{"curve": {"iteration": [1], "reward": [0.5]}}')):
        record_file(tmp_path, CONVENTIONAL, seed).write_text(text)
    with pytest.raises(RunError, match=r"conventional_seed0\.json: no training record"):
        matched_training.figure5(tmp_path, plants=(CONVENTIONAL,), seeds=(0,))
    record_file(tmp_path, CONVENTIONAL, 0).write_text('{"curve": {"iteration": [1, 2], "reward": [0.5, 0.6]}}')
    with pytest.raises(RunError, match="records of conventional differ in length"):
        matched_training.figure5(tmp_path, plants=(CONVENTIONAL,), seeds=(0, 1))


@pytest.mark.parametrize(
    "record",
    sorted(POLICIES.glob("*/*_seed*.json")),
    ids=lambda path: f"{path.parent.name}/{path.stem}",
)
def test_shipped_policies_of_the_studies_pass_the_walking_gate(record: Path) -> None:
    """Every record says so, and each lies next to its policy."""
    assert failed_conditions(record) == []
    assert record.with_suffix(".onnx").is_file()
