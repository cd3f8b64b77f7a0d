"""``train/ppo.py``: refusals in one line with exit code 2, a run from end to end, and Ctrl-C."""

import inspect
import json
import os
import signal
import subprocess
import sys
import time
from collections import Counter
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import pytest

from mrwarp.cli import main
from mrwarp.commands.run_train import Train
from mrwarp.enums import CurrentCommand, ZStep
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import RewardCfg, TerrainCfg
from mrwarp.options.command_line import CommandLine, option_fields, parse
from mrwarp.rl import checkpoint
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.ranks import Ranks
from mrwarp.rl.train_cfg import RunCfg, TrainCfg
from mrwarp.trials.walking import GateCheck, WalkingGate
from mrwarp.usd.open_stage import ASSETS
from paper.study.plan import POWER_PRICE

ROOT = Path(__file__).resolve().parents[2]
SCRIPT = ROOT / "train" / "ppo.py"


def test_defaults() -> None:
    """Those of the task: 64 environments on the CPU; the price in the help is that of the shipped policies."""
    assert f"policies/energy pay {POWER_PRICE:g}" in Path(inspect.getfile(Train)).read_text(encoding="utf-8")
    options = parse(Train, [], "mrwarp train")
    assert options.cfg == options.priced() == TrainCfg()
    assert (WalkingGate().num_envs, WalkingGate().seconds) == (64, 20.0)
    task = options.cfg.task
    assert (task.device, task.num_envs, task.seed, task.actuator) == ("cpu", 64, 0, "bouc_wen")
    assert (task.robot, task.payload, task.coupling.value, task.sal) == ("mr_go", 0, "constraint", True)


OPTIONS = {
    "num_envs": ("--num-envs 3", 3), "terrain": ("--terrain rough", TerrainCfg()), "sal": ("--sal off", False),
    "randomize": ("--randomize none", None), "currents": ("--current 0.2 1", (0.2, 1.0)), "seed": ("--seed 7", 7),
    "current_by": ("--current-by learned", CurrentCommand.LEARNED), "z_step": ("--z-step euler", ZStep.EULER),
    "rewards": ("--reward tilt=-9 --power-price 2", RewardCfg(weights={"tilt": -9.0, "power": -2.0})),
}  # fmt: skip
"""Options of the task, and what its fields then are."""


@pytest.mark.parametrize("name", OPTIONS)
def test_an_option_is_the_field_of_the_task(name: str) -> None:
    """The command line is read into the configuration that the environment takes; nothing else changes."""
    words, value = OPTIONS[name]
    cfg = parse(Train, words.split(), "mrwarp train").priced()
    assert getattr(cfg.task, name) == value
    assert cfg == TrainCfg(task=replace(TaskCfg(), **{name: value}))


def test_an_option_is_declared_once() -> None:
    """The command has no option that a configuration within it has, and each of those stands in one dataclass."""
    names = [name for _, _, name in option_fields(Train)]
    assert len(names) == len(set(names)) and {"num_envs", "desired_kl", "iterations", "current"} <= set(names)
    declared = Counter(name for kind in TaskCfg.__mro__ for name in vars(kind).get("__annotations__", ()))
    assert {name: count for name, count in declared.items() if count > 1} == {}


def test_earlier_spellings_are_taken_and_named(capsys: pytest.CaptureFixture[str]) -> None:
    """``--current`` was a law in train, ``--actuator-model`` a file; one line says what they are called now."""
    words = ["--actuator-model=own.st", "--actuator", "mlp", "--current", "scheduled"]
    task = parse(Train, words, "mrwarp train").cfg.task
    assert (task.actuator_file, task.current_by) == ("own.st", CurrentCommand.SCHEDULED)
    assert main(["train", *words]) == 2  # there is no such network
    said = capsys.readouterr().err.splitlines()
    notes = ["note: --actuator-model is called --actuator-file now", "note: --current is called --current-by now"]
    assert said[:2] == notes and "own.st" in said[2] and len(said) == 3


def start(*args: str) -> subprocess.Popen[str]:
    """The command as a user starts it, in a process of its own."""
    pipe = subprocess.PIPE
    return subprocess.Popen(
        [sys.executable, str(SCRIPT), *args],
        cwd=ROOT,
        stdout=pipe,
        stderr=pipe,
        text=True,
        env={**os.environ, "PYTHONUNBUFFERED": "1"},
    )


def test_short_training_from_end_to_end(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Two updates with 8 environments and a short gate: exit code 0, quiet, and what its files say."""
    gate = WalkingGate(num_envs=4, warmup=0.0, seconds=0.1)
    monkeypatch.setattr("mrwarp.rl.trainer.GateCheck", lambda cfg: GateCheck(cfg, gate=gate))
    out = tmp_path / "run"
    args = ["--device", "cpu", "--num-envs", "8", "--iterations", "2", "--no-gate", "--out", str(out)]
    args += ["--randomize", "ground", "--power-price", "0.01"]
    assert main(["train", *args], prog="train/ppo.py") == 0
    stdout, stderr = capsys.readouterr()
    assert stderr == ""
    assert "walking gate NOT met" in stdout and str(out) in stdout
    assert "first updates\n" in stdout  # the stage, once: no terminal redraws it
    result = json.loads((out / "result.json").read_text())
    assert (result["iterations"], result["stopped"], result["gate_passed"]) == (2, "iterations", False)
    assert result["gate"]["num_envs"] == 4 and result["gate"]["duration"] == pytest.approx(0.1)
    assert result["command"] == "python train/ppo.py " + " ".join(args)
    assert checkpoint.load(out / "checkpoint.pt")["iteration"] == 2
    task = OnnxPolicy(out / "policy.onnx").description["task"]
    assert (task["num_envs"], task["rewards"]["power"], task["randomize"]["gain_scale"]) == (8, -0.01, [1.0, 1.0])


@pytest.mark.slow
def test_ctrl_c_exits_130_with_a_checkpoint_to_resume(tmp_path: Path) -> None:
    """SIGINT in the middle of a long run: exit code 130, no traceback, and ``--resume`` goes on from there."""
    out = tmp_path / "run"
    args = ["--num-envs", "8", "--no-gate", "--save-every", "0.5", "--out", str(out)]
    process = start(*args, "--iterations", "100000")
    assert process.stdout is not None
    for line in process.stdout:
        if line.startswith("update"):
            break
    time.sleep(0.5)
    process.send_signal(signal.SIGINT)
    stdout, stderr = process.communicate(timeout=120)
    assert process.returncode == 130, stderr
    assert stderr == ""
    assert f"--resume {out / 'checkpoint.pt'}" in stdout
    done = checkpoint.load(out / "checkpoint.pt")["iteration"]
    assert json.loads((out / "result.json").read_text())["stopped"] == "interrupted"
    again = start(*args, "--iterations", str(done + 1), "--resume", str(out / "checkpoint.pt"))
    _, stderr = again.communicate(timeout=300)
    assert again.returncode == 0, stderr
    assert checkpoint.load(out / "checkpoint.pt")["iteration"] == done + 1


@pytest.mark.usefixtures("short_gate")
def test_resuming_takes_folder_and_options_from_the_checkpoint(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Only --resume is typed, and what may change: folder, seed and task are the checkpoint's, and it says so."""
    monkeypatch.chdir(tmp_path)
    out, kept = tmp_path / "a", tmp_path / "a" / "checkpoint.pt"
    task = ["--num-envs", "4", "--seed", "7", "--randomize", "ground", "--power-price", "0.01", "--entropy", "0.001"]
    task += ["--coupling", "explicit", "--iterations", "1", "--no-gate", "--out", str(out)]
    assert main(["train", *task]) == 0
    before = kept.read_bytes()
    capsys.readouterr()
    assert main(["train", *task]) == 2
    error = capsys.readouterr().err
    assert f"{kept} is there already; go on with --resume {kept}, choose another --out or add --overwrite" in error
    for option, said in {"--num-envs": "num_envs = 4, this run has 8", "--seed": "seed = 7, this run has 8"}.items():
        with monkeypatch.context() as patched:  # before an environment is made
            patched.setattr("mrwarp.rl.trainer.WalkEnv", None)
            assert main(["train", "--resume", str(kept), option, "8"]) == 2
        assert f"{kept}: trained with {said}; resume the same task" in capsys.readouterr().err
    assert kept.read_bytes() == before
    same = ["--coupling", "explicit", "--z-step", "exact"]  # typed again
    assert main(["train", "--resume", str(kept), "--iterations", "2", *same]) == 0
    assert f"going on from {kept}, update 1, with its options, in {out}" in capsys.readouterr().out
    content = checkpoint.load(kept)
    assert (content["iteration"], content["seed"], content["task"]["coupling"]) == (2, 7, "explicit")
    assert not (tmp_path / "runs").exists()
    assert main(["train", *task, "--overwrite"]) == 0
    assert checkpoint.load(kept)["iteration"] == 1


@pytest.mark.usefixtures("short_gate")
def test_a_coil_of_less_current_is_told(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A leg with a broken wire trains; the currents that it does not get are said."""
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    asset = tmp_path / "weak.usda"
    asset.write_text(text, encoding="utf-8")
    assert main(["asset", "set", str(asset), "FL_calf", "current_max", "0.3"]) == 0
    options = ["--num-envs", "4", "--iterations", "1", "--no-gate", "--asset", str(asset)]
    assert main(["train", *options, "--out", str(tmp_path / "out")]) == 0
    said = capsys.readouterr().out
    assert "warning: training currents up to 1.5 A are limited to 0.3 A at FL_calf, which take no more" in said


@pytest.mark.parametrize(("world", "code"), [(1, 1), (2, 0)])
def test_a_missed_gate_of_several_processes_is_no_error(
    world: int, code: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Torchrun shows a traceback after any other exit code than 0; a lone process ends with 1."""
    scene = SimpleNamespace(sim=SimpleNamespace(scene=SimpleNamespace(actuators=())), cfg=TaskCfg())
    result = {"stopped": "iterations", "gate_passed": False, "seconds": 1.0, "iterations": 1}
    trainer = SimpleNamespace(env=scene, run=lambda **_: result)
    monkeypatch.setattr("mrwarp.rl.trainer.Trainer", lambda *_, **__: trainer)
    monkeypatch.setattr(Ranks, "leave", lambda _: None)
    options = Train(cfg=TrainCfg(run=RunCfg(out=tmp_path)))
    assert options._train(CommandLine("mrwarp train", ()), Ranks(world=world)) == code


@pytest.mark.slow
def test_a_training_loads_no_compiler_and_no_pictures_before_it_begins() -> None:
    """torch's compiler and matplotlib cost 1.5 s of the start; an optimiser does not bring the compiler in either."""
    code = (
        "import sys; from mrwarp.runtime import quiet_libraries; quiet_libraries(); import mrwarp.rl.trainer; "
        "import torch; torch.optim.Adam([torch.nn.Parameter(torch.zeros(2))], fused=True).zero_grad(); "
        "print([name for name in ('torch._dynamo', 'matplotlib') if name in sys.modules])"
    )
    found = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True)
    assert found.stdout.splitlines()[-1] == "[]"


def test_a_flag_that_a_checkpoint_holds_may_be_typed_again() -> None:
    """``train --resume FILE --no-gate`` of a training without a gate: the parser does not know a flag that is set."""
    saved = parse(Train, ["--no-gate", "--seed", "3"], "mrwarp train")
    again = parse(Train, ["--no-gate", "--seed", "4"], "mrwarp train", saved)
    assert again.cfg.run.no_gate and again == parse(Train, ["--seed", "4"], "mrwarp train", saved)
