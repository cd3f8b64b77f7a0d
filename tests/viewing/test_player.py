"""``train/play.py``: refusals in one line, agents and policies from end to end, recordings that survive Ctrl-C."""

import json
import time
from pathlib import Path
from typing import Any

import numpy as np
import onnx
import pytest
import torch
from onnx import TensorProto, helper, numpy_helper
from rerun.chunk import RrdReader

from mrwarp.cli import main
from mrwarp.commands import run_play as play_cli
from mrwarp.commands.run_play import Play
from mrwarp.env.cfg import TaskCfg
from mrwarp.env.config.mdp_cfg import TerrainCfg
from mrwarp.env.observations import actor_terms
from mrwarp.options.command_line import CommandLine, parse
from mrwarp.resources import DEFAULT_POLICY, META
from mrwarp.rl.policy import OnnxPolicy
from mrwarp.rl.task_record import record
from mrwarp.trials.walking import make_env, measure
from mrwarp.viewing.live_view import Player, open_sink
from mrwarp.viewing.viewer import Viewer, free_port
from tests.messages import Refused


def write_policy(path: Path, *, actions: int = 12, seed: int = 2, **changes: Any) -> Path:
    """A policy of one random layer, small enough to keep the robot up, with a training task's description."""
    weight = np.random.default_rng(seed).normal(0.0, 0.02, (actions, 47)).astype(np.float32)
    graph = helper.make_graph(
        [helper.make_node("Gemm", ["obs", "w", "b"], ["actions"], transB=1)],
        "policy",
        [helper.make_tensor_value_info("obs", TensorProto.FLOAT, ["n", 47])],
        [helper.make_tensor_value_info("actions", TensorProto.FLOAT, ["n", actions])],
        [numpy_helper.from_array(weight, "w"), numpy_helper.from_array(np.zeros(actions, np.float32), "b")],
    )
    model = helper.make_model(graph, opset_imports=[helper.make_opsetid("", 18)], ir_version=10)
    description = {"observations": actor_terms(12), "task": {**record(TaskCfg()), **changes}}
    helper.set_model_props(model, {META: json.dumps(description)})
    onnx.save(model, str(path))
    return path


def last_heights(path: Path) -> dict[str, tuple[int, float]]:
    """Last logged trunk height of each robot in a recording: time [ns] and value [m]."""
    found: dict[str, tuple[int, float]] = {}
    for chunk in RrdReader(path).stream().filter(is_static=False):
        if chunk.entity_path.endswith("/series/trunk_height"):
            batch = chunk.to_record_batch()
            times = batch.column("sim_time").cast("int64").to_pylist()
            rows = zip(times, batch.column("Scalars:scalars").to_pylist(), strict=True)
            last = max((time, value[0]) for time, value in rows)
            robot = chunk.entity_path.split("/")[2]
            found[robot] = max(last, found.get(robot, last))
    return found


REFUSED: dict[str, tuple[list[str], tuple[str, ...]]] = {
    "two to play": (["--policy", "p.onnx", "--agent", "zero"], ("not allowed with",)),
    "a policy that is text": (["--policy", "{text}"], ("{text}", "not a readable ONNX model")),
    "a policy for another robot": (["--policy", "{narrow}"], ("{narrow}", "(1, 10)", "(1, 12)")),
    "a policy for another scale": (["--policy", "{scaled}"], ("{scaled}", "action_scale = 0.5", "0.25")),
    "an unknown robot": (["--agent", "zero", "--robot", "spot"], ("--robot", "spot", "mr_go")),
    "an unknown agent": (["--agent", "clever"], ("--agent", "clever", "random")),
    "too much payload": (["--agent", "zero", "--payload", "50"], ("--payload", "50; allowed: 0 to 20 kg")),
    "no robots": (["--agent", "zero", "--num-envs", "0"], ("--num-envs", "0 must be at least 1")),
    "no time": (["--agent", "zero", "--seconds", "0.5"], ("--seconds", "at least 1 s")),
    "a device that is not there": (["--agent", "zero", "--device", "cuda:99"], ("cuda:99", "choose from cpu")),
    "a missing asset": (["--agent", "zero", "--asset", "{tmp}/none.usda"], ("{tmp}/none.usda", "no such file")),
    "a recording of another name": (["--agent", "zero", "--rrd", "{tmp}/a.txt"], ("{tmp}/a.txt", ".rrd")),
    "a picture of another name": (["--agent", "zero", "--png", "{tmp}/a.jpg"], ("{tmp}/a.jpg", ".png")),
    "a folder that is a file": (["--agent", "zero", "--out", "{text}"], ("{text}", "is a file")),
    "a recording below a file": (["--agent", "zero", "--rrd", "{text}/a.rrd"], ("{text}", "cannot be written")),
    "two viewers": (["--agent", "zero", "--serve-web", "--connect"], ("not allowed with",)),
    "a viewer that is not there": (["--agent", "zero", "--connect", "{nobody}"], ("{nobody}", "no viewer listens")),
    "an address that is none": (["--agent", "zero", "--connect", "there"], ("there", "rerun+http://")),
}


@pytest.mark.parametrize("what", REFUSED)
def test_bad_input_is_refused_in_one_line(what: str, tmp_path: Path, refused: Refused) -> None:
    """Exit code 2, one line on stderr that names option and value, and nothing written."""
    text = tmp_path / "notes.txt"
    text.write_text("no policy\n")
    narrow = write_policy(tmp_path / "narrow.onnx", actions=10)
    scaled = write_policy(tmp_path / "scaled.onnx", action_scale=0.5)
    nobody = f"rerun+http://127.0.0.1:{free_port()}/proxy"
    names = {"tmp": tmp_path, "text": text, "narrow": narrow, "scaled": scaled, "nobody": nobody}
    args, parts = REFUSED[what]
    before = sorted(tmp_path.iterdir())
    outputs = [] if {"--rrd", "--png", "--out", "--connect"} & set(args) else ["--rrd", f"{tmp_path}/out/walk.rrd"]
    error = refused("play", *(arg.format(**names) for arg in args), *outputs)
    assert all(part.format(**names) in error for part in parts), error
    assert sorted(tmp_path.iterdir()) == before and text.read_text() == "no policy\n"


def test_a_policy_is_played_as_it_was_trained_unless_an_option_says_else() -> None:
    """Robot, devices and ground are the policy's; machine, files and seed are one's own."""
    said = record(TaskCfg(payload=3, sal=False, coil_lag=0.01, terrain=TerrainCfg(), num_envs=64, seed=8))
    words = ("--policy", str(DEFAULT_POLICY), "--payload", "1")
    found = parse(Play, words, "play")._cfg(CommandLine("mrwarp play", words), said)
    assert found == TaskCfg(payload=1, sal=False, coil_lag=0.01, terrain=TerrainCfg(), num_envs=4)


def test_policy_from_end_to_end(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Recording, picture and figures of one run; the figures are those of ``measure`` on the same robots."""
    policy = write_policy(tmp_path / "policy.onnx", sal=False)
    rrd, png, out = tmp_path / "new" / "walk.rrd", tmp_path / "walk.png", tmp_path / "out"
    args = ["--policy", str(policy), "--rrd", str(rrd), "--png", str(png), "--out", str(out), "--seconds", "2"]
    assert main(["play", *args]) == 0
    printed = capsys.readouterr()
    assert printed.err == "" and "SAL off" in printed.out and str(rrd) in printed.out
    assert {p.name for p in tmp_path.iterdir()} == {"policy.onnx", "new", "walk.png", "out"}
    assert [p.name for p in rrd.parent.iterdir()] == ["walk.rrd"]
    assert png.read_bytes().startswith(b"\x89PNG") and 20_000 < png.stat().st_size < 300_000

    result = json.loads((out / "result.json").read_text())
    env = make_env(TaskCfg(num_envs=4, sal=False), 4, seed=0)
    command = torch.tensor([0.5, 0.0, 0.0])
    expected = measure(env, OnnxPolicy(policy), command.repeat(4, 1), warmup=0.5, seconds=1.5)
    assert {name: result[name] for name in expected} == json.loads(json.dumps(expected))
    assert (result["speed"], result["shown_seconds"], result["currents"]) == (0.5, 2.0, [0.0, 0.5, 1.0, 1.5])
    assert result["command"] == "mrwarp play " + " ".join(args) and result["seed"] == 0

    heights = last_heights(rrd)
    assert set(heights) == {"0_0A", "1_0.5A", "2_1A", "3_1.5A"}
    for k, (last, height) in enumerate(heights[name] for name in sorted(heights)):
        assert last == 2_000_000_000
        assert np.float32(height) == np.float32(env.root_pos[k, 2])


@pytest.mark.parametrize("agent", ["zero", "random"])
def test_agents_run(agent: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Without a policy: both agents run, and twice the same seed gives the same figures."""
    args = ["--agent", agent, "--seconds", "1", "--num-envs", "2", "--current", "0", "1.5", "--seed", "4"]
    results = []
    for run in ("a", "b"):
        assert main(["play", *args, "--out", str(tmp_path / run)]) == 0
        results.append(json.loads((tmp_path / run / "result.json").read_text()))
    capsys.readouterr()
    assert results[0]["currents"] == [0.0, 1.5]
    same = set(results[0]) - {"command", "wall_seconds"}
    assert {name: results[0][name] for name in same} == {name: results[1][name] for name in same}


def test_interrupted_recording_is_whole(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Ctrl-C in the 31st step: exit code 130, a readable recording up to there, and no figures."""
    steps = 0

    def interrupted(name: str, env: Any) -> Any:
        def act(obs: Any) -> torch.Tensor:
            nonlocal steps
            steps += 1
            if steps > 30:
                raise KeyboardInterrupt
            return torch.zeros(env.num_envs, 12)

        return act

    monkeypatch.setattr(play_cli, "make_agent", interrupted)
    rrd, out = tmp_path / "walk.rrd", tmp_path / "out"
    code = main(["play", "--agent", "zero", "--rrd", str(rrd), "--out", str(out), "--num-envs", "1"])
    assert code == 130 and "stopped" in capsys.readouterr().err
    assert last_heights(rrd)["0_0A"][0] == 30 * 20_000_000
    assert [path.name for path in tmp_path.iterdir()] == ["walk.rrd"]


def test_live_run_keeps_real_time_and_reaches_the_viewer(viewer: Viewer) -> None:
    """Sent to a running viewer, 1.5 s of walking take 1.5 s, and everything arrives."""
    env = make_env(TaskCfg(num_envs=4), 4, seed=0)
    agent, sink = play_cli.make_agent("zero", env), open_sink(url=viewer.url)
    player = Player(env, agent, speed=0.0, shown=range(4), sink=sink)
    started = time.perf_counter()
    player.play(1.5, warmup=0.5)
    wall = time.perf_counter() - started
    assert player.close(timeout=20.0) and player.dropped == 0
    assert wall >= 1.5


def test_falls_are_reported(tmp_path: Path) -> None:
    """A robot that folds its legs falls; robot, current and time are in the figures."""
    env = make_env(TaskCfg(num_envs=2), 2, seed=0)
    folded = torch.zeros(2, 12)
    folded[1, 1::3], folded[1, 2::3] = 6.0, -6.0
    player = Player(env, lambda _: folded, speed=0.0, shown=[0, 1])
    falls = player.play(2.0, warmup=0.5)["falls"]
    assert falls and {fall["robot"] for fall in falls} == {1}
    assert all(fall["current"] == 1.0 and 0.0 < fall["time"] <= 2.0 for fall in falls)


def test_many_robots_are_shown_in_part() -> None:
    """Up to eight robots are drawn; of more, eight that are spread over all groups of currents."""
    assert play_cli.shown(3) == [0, 1, 2]
    shown = play_cli.shown(64)
    assert len(shown) == 8 and len(set(shown)) == 8
    assert [env * 4 // 64 for env in shown] == [0, 0, 1, 1, 2, 2, 3, 3]
