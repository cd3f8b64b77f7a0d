"""Bad input to any command: exit code 2, one line that names place, value and remedy, nothing written."""

import runpy
import sys
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import numpy as np
import pytest
import torch
from tyro.conf import Positional

from mrwarp import cli
from mrwarp.model_file import save_model
from mrwarp.options.command_line import CommandLine, OptionError, parse
from mrwarp.options.option_types import one, some
from mrwarp.recording.load import Holding
from mrwarp.resources import DEFAULT_POLICY
from mrwarp.usd.open_stage import ASSETS
from tests.messages import Refused, has_parts
from tests.models import paper_model
from tests.robot_logs.arm_log import arm_log

SEEDED: dict[str, list[str]] = {
    "fit": ["data.csv"],
    "learn": ["data.csv", "--out", "out"],
    "mission": ["--out", "out"],
    "walk": ["--out", "out"],
    "bench": ["--out", "out"],
    "impact": ["--out", "out"],
    "diagnose": ["data.csv"],
    "play": ["--agent", "zero"],
    "train": ["--out", "out"],
}
"""Further arguments of each command with a seed."""


@pytest.mark.parametrize("seed", ["-1", "9223372036854775808", "1.5"])
@pytest.mark.parametrize("command", SEEDED)
def test_a_seed_out_of_range(
    command: str, seed: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """Every command refuses the same seeds in the same words."""
    monkeypatch.chdir(tmp_path)
    line = refused(command, *SEEDED[command], "--seed", seed)
    assert "--seed" in line and seed in line
    assert "from 0 to 2^63 - 1" in line or "not a whole number" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("command", ["fit", "diagnose"])
@pytest.mark.parametrize("length", ["-1", "nan", "inf", "60.5", "short"])
def test_a_moving_average_out_of_range(command: str, length: str, refused: Refused) -> None:
    """Refused before anything is read."""
    line = refused(command, "nowhere.csv", "--predict", "nowhere.csv", "--averaged", length)
    assert "--averaged" in line and length in line
    assert "allowed: 0 to 60 s" in line or "is not a number" in line


def _motion(path: Path) -> Path:
    """A recording that can be read; a torque that is mostly noise."""
    rng, t = np.random.default_rng(3), np.arange(200) * 0.005
    rows = [f"{x:.3f},{np.sin(9 * x):.6f},{9 * np.cos(9 * x):.6f},1.0,{np.cos(9 * x) + rng.normal():.6f}" for x in t]
    path.write_text("t,q,qd,current,torque\n" + "\n".join(rows) + "\n")
    return path


@pytest.fixture
def bench(tmp_path: Path) -> Path:
    """A folder with a short recording of known motion and, next to it, break-away tests."""
    for name in ("data", "feet"):
        (tmp_path / name).mkdir()
        _motion(tmp_path / name / "run.csv")
    (tmp_path / "feet/units.json").write_text('{"q": "m", "qd": "m/s", "torque": "N"}')
    (tmp_path / "few.csv").write_text("current,torque\n0.5,10\n1.0,20\n")
    (tmp_path / "five.csv").write_text("current,torque\n0.5,10\n1.0,20\n1.5,25\n0.7,15\n1.2,22\n")
    return tmp_path


def not_reached(*_: object, **__: object) -> None:
    """Stands for the work that a refusal must come before."""
    raise AssertionError("the work has begun")


LATE: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "nothing to predict": (["--predict", "nofile"], ("nofile", "no such file")),
    "other units to predict": (["--predict", "feet"], ("feet", "m, A, N", "rad, A, N·m", "convert one of them")),
    "a recording for tests": (["--holding", "data/run.csv"], ("data/run.csv", "200 break-away tests at 1 currents")),
    "two tests": (["--holding", "few.csv"], ("few.csv", "2 break-away tests at 2 currents", "needs 5 tests")),
    "no tests": (["--holding", "nofile.csv"], ("nofile.csv", "no such file")),
    "an output that is a file": (["--out", "few.csv"], ("few.csv", "cannot be written")),
}


@pytest.mark.parametrize("what", LATE)
def test_fit_refuses_before_it_fits(what: str, bench: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused) -> None:
    """Inputs of later steps are read and checked before the search."""
    monkeypatch.chdir(bench)
    import mrwarp.identify.mechanics_fit  # noqa: F401 - loaded later, it would keep the stand-in

    monkeypatch.setattr("mrwarp.identify.fit.fit", not_reached)
    args, parts = LATE[what]
    before = sorted(bench.rglob("*"))
    line = refused("fit", "data", "--out", "out", *args)
    assert all(part in line for part in parts), line
    assert sorted(bench.rglob("*")) == before


@pytest.mark.parametrize("what", ["five.csv", "few.csv", ""])
def test_fit_takes_the_tests_beside_the_data(
    what: str, bench: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """As ``mrwarp check`` finds them, and it says so; too few are left out."""

    class Seen(Exception):
        """Ends the command where it would fit."""

    def fit(*_: object, holding: Holding | None, **__: object) -> None:
        assert (len(holding.current) if holding else 0) == (5 if what == "five.csv" else 0)
        raise Seen

    monkeypatch.setattr("mrwarp.identify.mechanics_fit.fit_joint", fit)
    if what:
        (bench / "data/holding.csv").write_bytes((bench / what).read_bytes())
    with pytest.raises(Seen):
        cli.main(["fit", str(bench / "data"), "--out", str(bench / "out")])
    out = capsys.readouterr().out
    file = bench / "data/holding.csv"
    assert (f"eq. 18: break-away torques of {file}\n" in out) == (what == "five.csv")
    assert (f"no eq. 18: {file} is not used: 2 break-away tests" in out) == (what == "few.csv")


def test_diagnose_compares_the_units_before_it_diagnoses(
    bench: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """Recordings to predict in other units."""
    monkeypatch.setattr("mrwarp.diagnose.pipeline.diagnose", not_reached)
    line = refused("diagnose", str(bench / "data"), "--predict", str(bench / "feet"))
    assert "convert one of them" in line


@pytest.mark.parametrize(
    ("args", "message"),
    [
        (["--out", "few.csv"], "few.csv: cannot be written"),
        (["--start-from", "bad.onnx"], "bad.onnx: not a readable ONNX model"),
        (["--start-from", "nofile.onnx"], "nofile.onnx: no such file"),
        (["--start-from", "nofile.pt"], "nofile.pt: no such file"),
        (["--resume", "nofile.pt"], "nofile.pt: no such checkpoint"),
    ],
)
def test_train_refuses_before_it_builds_robots(
    args: list[str], message: str, bench: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """Output folder and the file to begin with are looked at first."""
    monkeypatch.chdir(bench)
    monkeypatch.setattr("mrwarp.rl.trainer.WalkEnv", not_reached)
    (bench / "bad.onnx").write_text("this is no policy")
    before = sorted(bench.rglob("*"))
    assert message in refused("train", "--num-envs", "2", "--out", "out", *args)
    assert sorted(bench.rglob("*")) == before


def test_figure_4_tries_its_folder_before_the_bench(
    bench: Path, monkeypatch: pytest.MonkeyPatch, refused: Refused
) -> None:
    """``reproduce fig4 --train`` with a file as output."""
    monkeypatch.setattr("paper.reproduce.fig4.run_bench", not_reached)
    line = refused("reproduce", "fig4", "--train", "--out", str(bench / "few.csv"))
    assert "few.csv: cannot be written" in line


def test_bench_reads_the_policy_before_it_begins(bench: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A policy that is none: one line, without progress before it, and no folder."""
    (bench / "bad.onnx").write_text("this is no policy")
    assert cli.main(["bench", "--out", str(bench / "out"), "--policy", str(bench / "bad.onnx")]) == 2
    error = capsys.readouterr().err
    assert error.startswith(f"mrwarp bench: {bench}/bad.onnx: not a readable ONNX model") and error.count("\n") == 1
    assert not (bench / "out").exists()


def test_an_error_stands_on_a_line_of_its_own_below_the_progress(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """An error during the bench leaves the line that says how far it was."""

    def fail(_: object, report: Callable[[float, str], None], *_more: object) -> None:
        report(0.5, "walking")
        raise ValueError("it fell")

    monkeypatch.setattr("mrwarp.bench.virtual_bench.run_bench", fail)
    assert cli.main(["bench", "--out", str(tmp_path / "out")]) == 2
    assert capsys.readouterr().err.splitlines()[-1] == "mrwarp bench: it fell"
    assert not (tmp_path / "out").exists()


OUT_OF_RANGE: dict[str, list[tuple[list[str], str]]] = {
    **{
        name: [
            (["--current", "nan"], "nan .. allowed"),
            (["--current", "500"], "500 .. allowed"),
            (["--speed", "1e9"], "1e9 .. allowed"),
            (["--distance", "1e12"], "1e12 .. allowed"),
        ]
        for name in ("walk", "mission")
    },
    "reproduce": [
        (["table6", "--out", "x", "--distance", "0"], "--distance: 0 must be a positive number"),
        (["table6", "--out", "x", "--distance", "nan"], "--distance: nan must be a positive number"),
        (["table6", "--out", "x", "--distance", "inf"], "--distance: inf must be a positive number"),
        (["table6", "--out", "x", "--rollouts", "0"], "--rollouts: 0 must be at least 1"),
        (["table4", "--out", "x", "--impacts", "1.5"], "--impacts: '1.5' is not a whole number"),
        (["table4", "--out", "x", "--threads", "-1"], "--threads: -1 must be at least 0"),
        (["fig10", "--out", "x", "--window", "nan"], "--window: nan must be a positive number"),
        (["fig10", "--out", "x", "--window", "inf"], "--window: inf must be a positive number"),
    ],
    "impact": [
        (["--current", "nan"], "nan .. 0 to 100 A"),
        (["--current", "0", "-1"], "-1 .. 0 to 100 A"),
        (["--force", "nan", "0", "0"], "nan .. -10000 to 10000 N"),
        (["--force", "0", "0", "1e9"], "1e9 .. -10000 to 10000 N"),
        (["--speed", "nan"], "nan .. -5 to 5 m/s"),
        (["--speed", "1e9"], "1e9 .. -5 to 5 m/s"),
        (["--duration", "inf"], "inf .. positive"),
        (["--trials", "0"], "0 .. least 1"),
    ],
    "bench": [(["--trajectories", "0"], "0 .. least 1"), (["--evaluation-samples", "-1"], "at least 0")],
    "learn": [(["data", "--out", "o", "--epochs", "0"], "0 .. least 1")],
    "perf": [
        (["--steps", "-1"], "-1 .. least 0"),
        (["--threads", "-1"], "-1 .. least 0"),
        (["--num-envs", "4", "0"], "0 .. least 1"),
    ],
    "train": [
        (["--threads", "-1"], "-1 .. least 0"),
        (["--save-every", "nan"], "nan .. least 0"),
        (["--num-envs", "-3"], "--num-envs .. -3 must be at least 1"),
        (["--num-envs", "0"], "--num-envs .. 0 must be at least 1"),
        (["--iterations", "0"], "--iterations .. 0 must be at least 1"),
        (["--power-price", "-1"], "--power-price .. -1 must be at least 0"),
    ],
    "play": [
        (["--agent", "zero", "--current", "inf"], "inf .. 0 to 100 A"),
        (["--agent", "zero", "--speed", "6"], "6 .. -5 to 5 m/s"),
        (["--agent", "zero", "--seconds", "nan"], "nan .. finite"),
        (["--agent", "zero", "--web-port", "65536"], "65536 .. 1 to 65535"),
    ],
    "sweep": [(["--out", "o", "--command", "fit", "--grid", "seed=1", "--gpus", "-1"], "-1 .. least 0")],
    "replay-dump": [(["dump.safetensors", "--rows", "0"], "0 .. least 1")],
}


@pytest.mark.parametrize(
    ("command", "args", "message"),
    [
        pytest.param(command, *case, id=f"{command} {' '.join(case[0])}")
        for command, cases in OUT_OF_RANGE.items()
        for case in cases
    ],
)
def test_a_number_out_of_range(
    command: str,
    args: list[str],
    message: str,
    refused: Refused,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Refused when the arguments are read, with the option's name."""
    monkeypatch.chdir(tmp_path)
    line = refused(command, *args)
    assert has_parts(line, message) and "argument --" in line
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize(
    "args", [["impact", "--trials", "1", "--coupling", "constraint"], ["play", "--agent", "zero", "--num-envs", "1"]]
)
def test_more_current_than_the_coils_take(args: list[str], tmp_path: Path, refused: Refused) -> None:
    """The asset's devices are limited to 1.5 A: what is asked for above that is refused, not cut down silently."""
    line = refused(*args, "--out", str(tmp_path / "out"), "--current", "1.6")
    assert "--current 1.6" in line and "takes 0 to 1.5 A" in line
    assert not (tmp_path / "out").exists()


MESSAGES = {
    "walk --numbers no.json": "{tmp}/no.json .. numbers.json",
    "walk --numbers {tmp}": "{tmp} .. numbers.json",
    "walk --set regeneration=9": "regeneration = 9 .. 0 to 1",
    "perf --compare no.json": "no.json .. result.json",
    "perf --compare {tmp}": "{tmp} .. result.json",
    "asset export {usd} FL_calf --out {tmp}": "export: {tmp} .. directory .. another",
    "asset show {tmp}": "{tmp} .. folder .. .usda",
    "asset set no.usda FL_calf K1 9": "no.usda .. no such file .. check the path",
    "asset show {usd} --payload 3kg": "show: payload = '3kg' .. 0, 3",
    "asset show {usd} --robot spot": "show: robot = 'spot' .. go1, mr_go",
    "asset apply {usd} {tmp}/list.json": "list.json .. [1, 2] .. object",
    "asset apply {usd} {tmp}": "{tmp} .. model.json",
    "impact --policy {tmp}": "{tmp} .. folder .. .onnx",
    "bench --policy {tmp}": "{tmp} .. folder .. .onnx",
    "train --resume {tmp}": "{tmp} .. folder .. checkpoint",
    "replay-dump {tmp}": "{tmp} .. folder .. .safetensors",
    "bench --effect current_gain=99": "allowed: 0.1 to 10, ",
    "perf --rounds 1": "at least 2",
    "perf --device cuda:7": "cuda:7",
    "perf --device tpu": "tpu",
    "perf --policy no.onnx": "no.onnx",
    "impact --policy no.onnx": "no.onnx .. no such policy",
    "impact --duration 9": "must lie in",
    "impact --asset no.usda": "no such file",
    "mission --robot mr_go --calibrate": "needs Go1",
    "mission --calibrate --distance 50": "paper's task",
    "walk --policy no.onnx": "no such policy",
    "walk --speed 0.3 0.3": "speeds = (0.3, 0.3) .. name each once",
    "walk --sal on --robot go1": "exclude each other",
    "walk --set gear=1": "'gear' is not one number",
    "walk --set winding_resistance=1": "electrical.winding_resistance or thermal.winding_resistance",
    "walk --asset no.usda": "no.usda",
    "walk --calibrate --robot mr_go --distance 0.05 --trials 1": "needs Go1",
    "bench --effect nonsense=1": "known: coil_lag",
    "bench --effect coil_lag=fast": "'fast' is not a number",
    "bench --effect coil_lag": "not NAME=VALUE",
    "bench --effect coil_lag=9": "allowed: 0 to 1 s",
    "bench --scale-effects -1": "allowed: 0 to 10",
    "bench --samples 100": "fewer than 50 for each of 120",
    "bench --evaluation-samples 10": "0 or at least 200",
    "bench --policy no.onnx": "no such policy",
    "log record --out log --motion walk=5 chirp=5": "record two logs",
    "log record --out log --motion run=5": "there is no motion 'run'",
    "log record --out log --robot no.xml": "no.xml .. no such robot",
    "log record --out log --hide coil_daed=RL": "there is no effect",
    "sweep --out out --command train --grid actuator=magic": "magic",
    "reproduce docs --results {tmp}": "result.json",
    "reproduce --out x": "PART",
    "reproduce fig5 --out list.json": "list.json: cannot be written (it is a file); free it or name another --out",
    "robot fit-device {usd} --joint * --model {model} --scale limit": "--scale limit",
    "robot fit-device {usd} --joint * --model {model} --scale big": "--scale: 'big' is not a number; or say limit",
    "reproduce table99 --out x": "invalid choice: 'table99'",
    "study collect --out x --threads 2": "unrecognized arguments: --threads 2",
    "walk --model emp": "emp: .. did you mean emps?",
    "learn . --out o --bouc-wen emp": "emp: .. did you mean emps?",
    "device show emp": "there is no device 'emp'; did you mean 'emps'?",
    "walk --model emps": "its model is in m, A, N, the simulator's joints are in rad, A, N·m",
    "mission --model {model} --feedback": "--feedback: how .. warm up is not known: coil resistance; heat capacity",
    "train --model {model} --power-price 0.002": "--power-price 0.002: the coil resistance of FL_calf, FR_calf",
    "train --model {model} --actuator mlp": "models/mlp.safetensors: this mlp network {learned}",
    "train --model {model} --actuator pg_rlstm": "models/pg_rlstm.safetensors: this pg_rlstm network {learned}",
    "train --reward tlt=1": "reward 'tlt' is unknown; choose from track_velocity",
    "train --reward tilt": "give a term and its",
    "train --device cuda:99": "--device cuda:99 .. choose from cpu",
    "train --device tpu": "--device tpu .. choose from cpu",
    "train --device cuda:99 --backend mjbatch": "cuda:99",
    "train --num-envs 0.5": "--num-envs .. 0.5",
    "train --robot spot": "--robot .. spot .. mr_go",
    "train --gpu": "--gpu",
    "train --resume {tmp}/none.pt": "{tmp}/none.pt .. no such checkpoint",
    "train --asset {tmp}/none.usda": "{tmp}/none.usda .. no such file",
    "train --num-envs 2 --out list.json": "list.json",
    "train --actuator magic": "--actuator .. magic .. bouc_wen",
    "train --actuator-file list.json": "bouc_wen .. list.json",
    "train --actuator mlp --actuator-file {tmp}/none.st": "{tmp}/none.st",
    "train --randomize moon": "--randomize .. moon .. ground",
    "train --resume {evil}": "{evil} .. refused",
    "train --asset {text}": "{text} .. not readable as USD",
    "train --asset {k1}": "{k1} .. newton:mr:K1 .. -1 .. out of range .. 0 to 1e+15",
    "walk --robot beast": "beast",
    "walk --robot {usd}": "--policy",
    "walk --calibrate --speed 0.4": "--calibrate needs Go1 at 0.3 and 0.5 m/s with 0 and 3 kg",
    "walk --calibrate --sal on": "--calibrate needs Go1 at 0.3 and 0.5 m/s with 0 and 3 kg",
    "walk --calibrate --payload 0": "--calibrate needs Go1 at 0.3 and 0.5 m/s with 0 and 3 kg",
    "play --agent sine": "--agent sine",
    "monitor {tmp}": "holds no record",
    "asset apply {usd} no.json": "no.json: no such file",
    "asset export {usd} FL_hip --out o.json": "/mr_go/actuators/FL_hip is a plain motor",
    "fit {data} --skip-bad --predict list.json": "list.json",
    "learn {data} --out o --bouc-wen list.json": "list.json .. [1, 2] .. object",
    "diagnose list.json": "list.json",
    "diagnose {data} --model list.json": "list.json .. [1, 2] .. object",
    "diagnose {data} --model no.json": "no.json .. no such",
    "diagnose {data} --quick --impact": "--impact: needs a verdict",
    "diagnose {data} --quick --learn": "--learn: needs a verdict",
    "diagnose {data} --quick --predict {data}": "--predict: needs a verdict",
    "diagnose joint {data} --without coil_lagg": "--without coil_lagg: no such effect; did you mean 'coil_lag'",
    "diagnose joint {data} --keep coil_lag --without coil_lag": "--keep coil_lag: --without coil_lag",
    "diagnose {log} --rrd a.txt": ".rrd",
    "diagnose {log} --rrd a.rrd --quick": "--rrd: needs a verdict",
    "diagnose {log} --device cuda:99": "cuda:99: no such device here",
    "diagnose {log} --policy {policy}": "hangs or stands fixed",
    "diagnose {log} --policy no.onnx": "no such policy",
    "diagnose {log} --robot no.xml": "no.xml .. name its file",
}
"""Parts of the message of each command: place, value and remedy."""

K1 = "double newton:mr:K1 = 10.413315"


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path | str]:
    """A recording, the log of an arm, and the model of a device of which nobody stated the coil; three bad files."""
    folder = tmp_path_factory.mktemp("made")
    data, log = _motion(folder / "run.csv"), arm_log(folder / "log", seconds=1.0)
    model = save_model(paper_model(K1=7.0), folder / "model.json")
    learned = "learned another device than the joint's (K1 10.41 .. mrwarp learn DATA --bouc-wen MODEL.json"
    torch.save({"format": 1, "env": print}, folder / "evil.pt")  # a checkpoint that holds more than data
    (folder / "text.usda").write_text("this is no USD file\n")
    asset = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    assert asset.count(K1) == 1
    (folder / "k1.usda").write_text(asset.replace(K1, "double newton:mr:K1 = -1.0"), encoding="utf-8")
    bad = {"evil": folder / "evil.pt", "text": folder / "text.usda", "k1": folder / "k1.usda"}
    files = {**bad, "data": data, "log": log, "model": model, "usd": ASSETS / "mr_go.usda", "policy": DEFAULT_POLICY}
    return {**files, "learned": learned}


@pytest.mark.parametrize(("command", "message"), MESSAGES.items(), ids=list(MESSAGES))
def test_a_refusal_says_what_is_wrong_and_what_to_do(
    command: str,
    message: str,
    made: dict[str, Path | str],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    refused: Refused,
) -> None:
    """Files that are not there or something else, and names and values that are none."""
    monkeypatch.chdir(tmp_path)
    (tmp_path / "list.json").write_text("[1, 2]")
    names = {**made, "tmp": tmp_path}
    line = refused(*(word.format(**names) for word in command.split()))
    assert has_parts(line, message.format(**names).removeprefix(f"{tmp_path}/"))
    assert "Errno" not in line
    assert [path.name for path in tmp_path.iterdir()] == ["list.json"]


@pytest.mark.parametrize("command", list(cli.COMMANDS))
def test_a_flag_that_is_none(command: str, tmp_path: Path, refused: Refused) -> None:
    """Every command names it in one line and says where the options stand."""
    line = refused(command, "--nonsense")
    assert line.startswith(f"mrwarp {command}") and line.endswith(" --help\n") and "; see" in line


@pytest.mark.parametrize(
    ("script", "flag"), [("ppo", "--num-envs=x"), ("play", "--nonsense"), ("play", "--agent=zero --web-port 0")]
)
def test_the_scripts_call_themselves_what_they_are(
    script: str, flag: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """``train/ppo.py`` and ``train/play.py`` are ``mrwarp train`` and ``mrwarp play`` under names of their own."""
    path = Path(__file__).parents[1] / "train" / f"{script}.py"
    monkeypatch.setattr(sys, "argv", [str(path), *flag.split()])
    with pytest.raises(SystemExit) as leaving:
        runpy.run_path(str(path), run_name="__main__")
    assert leaving.value.code == 2
    error = capsys.readouterr().err
    assert error.startswith(f"train/{script}.py: ") and error.count("\n") == 1


def test_a_command_line_can_be_typed_again() -> None:
    """Commands kept in results: scripts are run by python, commands by themselves."""
    assert str(CommandLine("train/ppo.py", ("--out", "a b"))) == "python train/ppo.py --out 'a b'"
    assert str(CommandLine("mrwarp train", ("--seed", "1"))) == "mrwarp train --seed 1"


@dataclass(frozen=True, kw_only=True)
class Pushed:
    """Options of a command."""

    value: Positional[Annotated[float | None, one(float, "VALUE")]] = None
    """a value"""
    force: Annotated[tuple[float, ...], some(float, "N")] = ()
    """a force"""


@pytest.mark.parametrize("number", ["-1e30", "-1E-3", "-.5", "-1.", "-inf", "-nan", "-5", "-1.5e+3"])
def test_negative_numbers_are_values(number: str) -> None:
    """However they are written; a word that begins with a minus is not."""
    found = parse(Pushed, [number, "--force", "0", number, "0"], "p")
    assert str(found) == str(Pushed(value=float(number), force=(0.0, float(number), 0.0)))
    assert str(parse(Pushed, [f"--force={number}"], "p").force) == str((float(number),))
    with pytest.raises(OptionError, match="unrecognized arguments: -x"):
        parse(Pushed, ["-x"], "p")


@pytest.mark.parametrize(
    ("argv", "parts"),
    [
        (["check"], ("required", "DATA")),
        (["train", "--num-evs", "4"], ("--num-evs 4", "did you mean --num-envs?")),
        (["train", "--robot", "spot"], ("--robot", "'spot'", "mr_go, go1")),
        (["train", "--num-envs"], ("--num-envs", "expected 1 value")),
        (["train", "--live", "--rrd", "a.rrd"], ("--rrd", "not allowed with argument --live")),
        (["play"], ("--policy --agent is required",)),
        (["play", "--agent", "zero", "--current"], ("--current", "at least one value")),
    ],
)
def test_what_cannot_be_read(argv: list[str], parts: tuple[str, ...], refused: Refused) -> None:
    """Option, value and what is allowed."""
    line = refused(*argv)
    assert all(part in line for part in parts) and line.endswith("; see --help\n")


@pytest.mark.parametrize(("word", "hint"), [("fitt", "did you mean 'fit'? see"), ("--versoin", "; see mrwarp --help")])
def test_a_misspelt_command(word: str, hint: str, capsys: pytest.CaptureFixture[str]) -> None:
    """One line with the nearest name."""
    assert cli.main([word]) == 2
    error = capsys.readouterr().err
    assert error.count("\n") == 1 and f"there is no command {word!r}" in error and hint in error
