"""``docs/extend.md`` is done as it stands there, in a copy of the package, and what it adds is used."""

import re
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
STEP = re.compile(
    r"^`([\w/.]+)`(?:, after the line `([^`]+)`)?:\n\n```(?:python|text)\n(.*?)^```", re.MULTILINE | re.DOTALL
)
"""A file of the page, the line after which something is added (else the file is new), and what."""

EFFECT_AND_LAW = """
import numpy as np
from mrwarp.effects.catalogue import CATALOGUE, HYSTERESIS
from mrwarp.identify.parameters import slots_of
from mrwarp.model_file import make_effect
from tests.effects import along
import warp as wp

wp.config.log_level = wp.LOG_WARNING
shaft = along.Shaft.swinging(seconds=1.0)
cases = [{}, {"end_stop": {"stiffness": 2.0, "way": 0.1}}, {"soft_sign": {"rate": 3.0}}]
plain, stop, soft = along.torques(shaft, along.TRUTH, cases).astype(float)
beyond = shaft.q - np.clip(shaft.q, -0.1, 0.1)
assert np.abs(beyond).max() > 0.05
np.testing.assert_allclose(stop - plain, SIGN * 2.0 * beyond, rtol=0, atol=1e-4)
assert np.abs(soft - plain).max() > 0.01
assert [s.parameter.name for s in slots_of("end_stop")] == ["stiffness", "way"]
assert make_effect("end_stop", {"stiffness": 2.0, "way": 0.1}).values == {"stiffness": 2.0, "way": 0.1}
assert "end_stop" in CATALOGUE and "soft_sign" in HYSTERESIS

from tests.effects import test_catalogue, test_path
test_catalogue.test_tokens_are_those_of_the_contract()
test_catalogue.test_every_file_of_a_law_is_listed_once()
for test in (
    test_catalogue.test_law_is_complete, test_catalogue.test_parameters_have_unit_bounds_and_null,
    test_path.test_effect_at_null_leaves_every_bit, test_path.test_ranges_have_the_units_of_the_parameters,
    lambda name: test_path.test_units_of_the_parameters_are_those_of_the_law([name]),
):
    test("end_stop")
"""

REWARD_AND_OPTION = """
import torch
from mrwarp.commands.run_train import Train
from mrwarp.env.rewards import TERMS, weight
from mrwarp.env.vec_env import WalkEnv
from mrwarp.options.command_line import parse

task = parse(Train, ["--num-envs", "2", "--randomize", "none", "--reward", "sideways=-2"], "train").cfg.task
env = WalkEnv(task)
env.step(torch.zeros(2, env.num_actions))
found, speed = env.arrays.terms[:, list(TERMS).index("sideways")], env.body_velocity[:, 1]
assert weight(task.rewards, "sideways") == -2.0 and bool((speed != 0.0).any())
torch.testing.assert_close(found, speed * speed)

from mrwarp.cli import main
try:
    main(["fit", "--help"])
except SystemExit:
    pass
"""


CAUSE = """
import tempfile
from pathlib import Path
import mujoco
import numpy as np
from mrwarp.robot_logs.causes.parameter import parameters_of
from mrwarp.robot_logs.extended_robot import write_extended
from mrwarp.robot_logs.replay_model import replay_model
from mrwarp.robot_logs.robot_log import load_log
from mrwarp.robot_logs.unknowable import ARM_MOTIONS
from mrwarp.robot_logs.window_replay import ParameterBatch, Replay, nuisances
from mrwarp.robot_logs.windows import cut_windows
from tests.robot_logs.arm_log import arm_log
from types import SimpleNamespace
import warp as wp

wp.config.log_level = wp.LOG_WARNING
folder = Path(tempfile.mkdtemp())
log = load_log(arm_log(folder / "log", seconds=2.0))
model = replay_model(folder / "log" / "arm.xml", log)
parameters = parameters_of(model, log)
k = next(k for k, p in enumerate(parameters) if (p.cause, p.where) == ("joint_spring", "elbow"))
assert (parameters[k].name, parameters[k].unit, "joint_spring" in ARM_MOTIONS) == ("stiffness", "N·m/rad", True)
theta = np.zeros(len(parameters))
theta[k] = 3.0
d = SimpleNamespace(parameters=parameters, theta=theta, model=model, log=log, session={})
assert write_extended(d, folder) == (["robot.xml", "model.json"], [])
written = replay_model(folder / "robot.xml", log)
assert written.model.joint("elbow").stiffness[0] == 3.0 and written.model.joint("shoulder").stiffness[0] == 0.0

def replayed(robot, theta):
    (windows,) = cut_windows(robot, log)
    start = np.zeros((windows.count, len(nuisances(robot))))
    batch = ParameterBatch.of(parameters, np.tile(theta, (windows.count, 1)), robot)
    return Replay(robot, windows).run(batch, np.arange(windows.count), start)["q"]

changed = replayed(model, theta)
assert np.abs(changed - replayed(model, 0.0 * theta)).max() > 0.01
np.testing.assert_allclose(changed, replayed(written, 0.0 * theta), rtol=0, atol=1e-6)
"""

NAMED = """
import tempfile
from pathlib import Path
from mrwarp.robot_logs.robot_diagnosis import diagnose_log
from mrwarp.robot_logs.robot_log import load_log
from tests.robot_logs.arm_log import arm_log

def spring(model):
    model.jnt_stiffness[model.joint("elbow").id] = 1.5

folder = arm_log(Path(tempfile.mkdtemp()), seconds=6.0, change=spring)
d = diagnose_log(folder / "arm.xml", load_log(folder))
(cause,) = d.causes
assert (cause.name, cause.where) == ("joint_spring", "elbow"), d.sentence
low, high = cause.parameters["stiffness"].ci95
assert low < 1.5 < high < low + 0.5, (low, high)
assert d.sentence.startswith("elbow: spring +1."), d.sentence
"""


@pytest.fixture(scope="module")
def extended(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A copy of the package with all that the page adds, next to what it takes from a checkout."""
    root = tmp_path_factory.mktemp("extended")
    shutil.copytree(ROOT / "mrwarp", root / "mrwarp", ignore=shutil.ignore_patterns("__pycache__"))
    for name in ("assets", "models", "policies", "tests"):
        (root / name).symlink_to(ROOT / name)
    steps = STEP.findall((ROOT / "docs" / "extend.md").read_text(encoding="utf-8"))
    assert [bool(after) for _, after, _ in steps] == [False, True, False, True, True, False, True]
    for name, after, text in steps:
        path = root / name
        assert path.is_file() == bool(after), name
        lines = path.read_text(encoding="utf-8").splitlines(keepends=True) if after else []
        at = [k + 1 for k, line in enumerate(lines) if line.strip() == after] if after else [0]
        assert len(at) == 1, f"{name}: {after!r} stands there {len(at)} times"
        lines.insert(at[0], f"\n\n{text}" if after and text.startswith("@") else text)
        path.write_text("".join(lines), encoding="utf-8")
    return root


def run(root: Path, code: str) -> str:
    """Output of Python with the extended package."""
    path = {"PYTHONPATH": str(root), "PATH": "/usr/bin:/bin", "HOME": str(Path.home())}
    command = [sys.executable, "-c", f"import mrwarp; assert mrwarp.__file__.startswith({str(root)!r})\n{code}"]
    done = subprocess.run(command, cwd=root, env=path, capture_output=True, text=True, timeout=500, check=False)
    assert done.returncode == 0, done.stderr
    return done.stdout


def test_an_effect_and_a_law_act_in_the_kernels_are_searched_and_stored(extended: Path) -> None:
    """One file and one line each."""
    run(extended, EFFECT_AND_LAW.replace("SIGN", "1.0"))


@pytest.mark.slow
def test_an_edited_effect_is_compiled_again(extended: Path) -> None:
    """With the other sign of its torque."""
    file = extended / "mrwarp" / "effects" / "end_stop.py"
    file.write_text(
        file.read_text(encoding="utf-8").replace("s.torque + values", "s.torque - values"), encoding="utf-8"
    )
    run(extended, EFFECT_AND_LAW.replace("SIGN", "-1.0"))


def test_a_reward_term_is_an_option_of_train_and_a_law_one_of_fit(extended: Path) -> None:
    """The composed kernel gives the term's value; the command lines know both names."""
    assert "soft_sign" in run(extended, REWARD_AND_OPTION)


def test_a_cause_of_a_robot_is_replayed_and_written(extended: Path) -> None:
    """One file and one line: the change acts as that of the extended robot's file does, and an arm's advice has it."""
    run(extended, CAUSE)


@pytest.mark.slow
def test_a_cause_of_a_robot_is_named(extended: Path) -> None:
    """The diagnosis finds what the page adds, with no other line of the method."""
    run(extended, NAMED)
