"""Every example of README, docs and models runs as it stands there: a page's blocks in order, in a folder of their own.

Two things differ from a reader's terminal: commands that take minutes run at the sizes of :data:`SHORT`, and what
:data:`NOT_RUN` lists is only read.
"""

import re
import shlex
import shutil
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from string import Template

import pytest

from mrwarp.cli import main
from mrwarp.options.command_line import option_flags
from mrwarp.options.command_table import all_commands

ROOT = Path(__file__).resolve().parents[2]
PAGES = {str(page.relative_to(ROOT)): page for page in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md")))}
PAGES["models/README.md"] = ROOT / "models" / "README.md"
FENCE = re.compile(r"^```(\w*)\n(.*?)^```$", re.MULTILINE | re.DOTALL)
COMMANDS = dict(all_commands())

LANGUAGES = {"bash", "python", "text", "json", "usda", "csv"}
"""Kinds of blocks; commands and their output stand in two blocks, bash and text."""

NOT_RUN = {
    "make test": "runs these very tests",
    ". .venv/bin/activate": "is for the reader's shell",
    "torchrun": "tests/rl/test_ranks.py",
    "python -m benchmarks": "minutes to days; tests/benchmarks runs each for a moment",
    "mrwarp diagnose joint runs/hidden": "reads what the command before it hides",
    "mrwarp diagnose robot runs/go2": "reads what the command before it made; tests/robot_logs",
    "mrwarp log import": "reads a bag of others; tests/robot_logs",
    "mrwarp diagnose robot my_dataset": "reads a data set of others; tests/robot_logs",
    "mrwarp check runs/go2": "reads what the command before it made; tests/robot_logs",
    "rerun": "opens a window",
    "mrwarp demo": "tests/commands/test_run_demo.py",
    "mrwarp perf": "minutes; tests/benchmarks/perf",
    "mrwarp sweep": "minutes of trainings; tests/sweep",
    "mrwarp study train": "hours; tests/paper/study",
    "mrwarp study collect": "takes what those hours made; tests/paper/study",
    "mrwarp reproduce all": "minutes; tests/paper/reproduce/test_headlines.py",
    "mrwarp reproduce table2": "minutes; tests/paper/reproduce/test_headlines.py",
    "mrwarp reproduce table6": "minutes; tests/paper/reproduce/test_headlines.py",
    "mrwarp reproduce fig4 --train": "hours; tests/paper/reproduce/test_fig4.py",
    "mrwarp reproduce table4": "minutes; tests/paper/reproduce/test_headlines.py",
    "mrwarp monitor": "reads records of others; tests/identify/test_monitor.py",
    "git clone": "needs a network",
    "mrwarp robot": "reads a robot of others; tests/robots",
    "mrwarp train --robot": "reads what the command before it made; tests/robots",
    "mrwarp walk --policy runs/go2/policy.onnx": "reads what the command before it made; tests/robots",
    "mrwarp impact --policy runs/go2/policy.onnx": "reads what the command before it made; tests/robots",
    "mrwarp impact --robot": "reads what the command before it made; tests/robots",
    "mrwarp impact --live": "opens a window",
    "mrwarp play --policy runs/walk/policy.onnx": "opens a window",
    "mrwarp play --robot": "reads what the command before it made; tests/robots",
}
"""Beginnings of commands that are not run, and why, or what tests them.

`mrwarp play --policy` with ``--png`` is run anyway.
"""

SHORT = {
    "bench": {"--trajectories": "6", "--samples": "2400", "--evaluation-samples": "0"},
    "train": {"--iterations": "1", "--num-envs": "4"},
    "impact": {"--trials": "1"},
    "walk": {"--distance": "0.5", "--trials": "1"},
    "mission": {"--window": "0.5", "--trials": "1"},
    "play": {"--seconds": "1"},
    "log record": {"--motion": "chirp=2"},
}
"""Sizes here, which replace the page's or its defaults."""

MISSES = {"train", "asset diff"}
"""Commands that may end with 1: an aim is missed at these sizes, files differ."""

SCRIPTS = {"train/ppo.py": "train", "train/play.py": "play"}

MAKE_RUN = re.search(r"^run:.*\n\t(.*)$", (ROOT / "Makefile").read_text(encoding="utf-8"), re.MULTILINE)
"""The command of ``make run``."""


@dataclass(frozen=True)
class Block:
    """A fenced block of a page."""

    line: int
    language: str
    text: str
    follows: bool
    """Whether nothing stands between it and the block before it."""


def blocks(page: Path) -> list[Block]:
    """The blocks of a page in order."""
    text = page.read_text(encoding="utf-8")
    found, end = [], 0
    for match in FENCE.finditer(text):
        follows = not text[end : match.start()].strip()
        found.append(Block(text[: match.start()].count("\n") + 1, match[1], match[2], follows))
        end = match.end()
    return found


def typed(block: Block) -> Iterator[list[str]]:
    """The words of each command, as a shell would take them: comments, continued lines and variables."""
    values: dict[str, str] = {}
    for line in block.text.replace("\\\n", " ").splitlines():
        words = shlex.split(Template(line).safe_substitute(values), comments=True)
        if len(words) == 1 and (found := re.fullmatch(r"([A-Z]+)=(.*)", words[0])):
            values[found[1]] = found[2]
        elif words:
            yield words


def arguments(words: list[str]) -> list[str] | None:
    """Arguments of ``mrwarp`` in a command, which may run a script of it; None if it is none."""
    if words == ["make", "run"]:
        assert MAKE_RUN is not None
        words = MAKE_RUN[1].split()
    for script, command in SCRIPTS.items():
        if script in words:
            return [command, *words[words.index(script) + 1 :]]
    return words[1:] if words[0] == "mrwarp" else None


def command_of(argv: list[str]) -> str:
    """Name of the command, of one or two words."""
    return next((name for name in (" ".join(argv[:2]), argv[0]) if name in COMMANDS), argv[0])


def shortened(argv: list[str]) -> list[str]:
    """The commands at the sizes of :data:`SHORT`."""
    argv = list(argv)
    for option, value in SHORT.get(command_of(argv), {}).items():
        if option in argv:
            start = argv.index(option)
            end = next((k for k in range(start + 1, len(argv)) if argv[k].startswith("--")), len(argv))
            del argv[start:end]
        argv += [option, value]
    return argv


def left_out(words: list[str]) -> bool:
    """Whether a command is in :data:`NOT_RUN`."""
    line = " ".join(words)
    pictured = words[:3] == ["mrwarp", "play", "--policy"] and "--png" in words
    return not pictured and any(line == left or line.startswith(f"{left} ") for left in _beginnings())


def _beginnings() -> list[str]:
    return [*NOT_RUN, *(f"python -m benchmarks.{path.stem}" for path in (ROOT / "benchmarks").iterdir())]


@pytest.mark.parametrize("name", PAGES)
def test_blocks_say_what_they_are(name: str) -> None:
    """A language each, so that the page can be read by people and by the tests below."""
    assert [(block.line, block.language) for block in blocks(PAGES[name]) if block.language not in LANGUAGES] == []


@pytest.mark.parametrize("name", PAGES)
def test_commands_and_options_exist(name: str) -> None:
    """Also of the commands that are not run here."""
    unknown = []
    for block in blocks(PAGES[name]):
        for words in typed(block) if block.language == "bash" else ():
            argv = arguments(words)
            if argv is None:
                if not left_out(words):
                    unknown.append(f"{block.line}: {' '.join(words)}")
                continue
            command = command_of(argv)
            if command not in COMMANDS:
                unknown.append(f"{block.line}: {command}")
                continue
            variants = [COMMANDS[command], *COMMANDS[command].variants.values()]
            known = {f"--{option}" for entry in variants for option in option_flags(entry.load())}
            known |= {word for words in COMMANDS[command].variants for word in words} | {"--help", "--"}
            given = {word.partition("=")[0] for word in argv[: (argv + ["--"]).index("--")] if word.startswith("--")}
            unknown += [f"{block.line}: {command} {option}" for option in sorted(given - known)]
    assert unknown == []


def test_what_is_not_run_stands_in_a_page() -> None:
    """A reason that nothing needs any more is taken out."""
    lines = [
        " ".join(words)
        for page in PAGES.values()
        for block in blocks(page)
        if block.language == "bash"
        for words in typed(block)
    ]
    assert [left for left in NOT_RUN if not any(line.startswith(left) for line in lines)] == []


@pytest.mark.slow
@pytest.mark.usefixtures("short_gate")
@pytest.mark.parametrize("name", [name for name in PAGES if name != "docs/extend.md"])  # test_extend.py does
def test_a_page_runs_from_top_to_bottom(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """In a folder with the files of a checkout that examples name; a block of text is what the one before it prints."""
    shutil.copytree(ROOT / "assets", tmp_path / "assets")
    for folder in ("policies", "models", "train", "benchmarks"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    monkeypatch.chdir(tmp_path)
    namespace: dict[str, object] = {"__name__": "page"}
    said = ""
    found = blocks(PAGES[name])
    for block, after in zip(found, [*found, None][1:], strict=True):
        if block.language == "python":
            file = tmp_path / f"block_{block.line}.py"  # where Warp finds the source of a kernel
            file.write_text(block.text, encoding="utf-8")
            exec(compile(block.text, str(file), "exec"), namespace)
        elif block.language == "bash":
            run = [argv for words in typed(block) if not left_out(words) and (argv := arguments(words))]
            capsys.readouterr()
            for argv in run:
                refused = after is not None and after.follows and after.text.startswith(f"mrwarp {command_of(argv)}: ")
                code = main(shortened(argv))
                assert code == 2 * refused or (code == 1 and command_of(argv) in MISSES), f"line {block.line}: {argv}"
            said = "".join(capsys.readouterr()) if run else ""
        elif block.language == "text" and block.follows and said:
            missing = [line for line in block.text.splitlines() if " ".join(line.split()) not in " ".join(said.split())]
            assert missing == [], f"line {block.line}"
