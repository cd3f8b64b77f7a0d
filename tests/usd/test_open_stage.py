"""Files that crash, stall or bloat USD's reader: refused on one line, the process lives, and good files pay little."""

import os
import re
import signal
from pathlib import Path

import pytest

from mrwarp.usd import open_stage as asset_trial
from mrwarp.usd.asset import load_robot
from mrwarp.usd.open_stage import ASSETS, MAX_BYTES, MAX_CHOICES, MEMORY, AssetError, choices, open_here, try_out

HEAD = '#usda 1.0\n(\n    defaultPrim = "r"\n)\n'


def refusal(path: Path) -> str:
    """The one line with which a file is refused."""
    with pytest.raises(AssetError) as error:
        load_robot(path)
    text = str(error.value)
    assert text.startswith(str(path)) and "\n" not in text and len(text) < 1000
    return text


def written(path: Path, body: str) -> Path:
    """A file with a default prim of that body."""
    path.write_text(f'{HEAD}def "r"\n{{\n{body}\n}}\n', encoding="utf-8")
    return path


@pytest.mark.parametrize(
    ("place", "opening"), [("double newton:mr:K1 = 10", "["), ("upAxis = ", "{"), ("double newton:mr:K1 = 10", '{"a":')]
)
def test_deep_brackets_are_refused(tmp_path: Path, place: str, opening: str) -> None:
    """A hundred thousand open brackets, which overflow the reader's stack or are no USD, are refused."""
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    assert place in text
    (tmp_path / "a.usda").write_text(text.replace(place, place + 100_000 * opening, 1), encoding="utf-8")
    assert re.search(
        r"not readable as USD: .*; repair|USD's reader crashes .*; it is damaged", refusal(tmp_path / "a.usda")
    )


@pytest.mark.parametrize(
    ("body", "words"),
    [
        # brackets in a text of its own grammar, which no look at the file's own brackets sees
        ('pathExpression x = "' + 100_000 * "(" + "/a" + 100_000 * ")" + '"', ["crashes or takes more than"]),
        # six levels of twenty children each: 64 million prims out of 3 kB
        (
            "\n".join(
                f'class "c{level}"\n{{\n'
                + "\n".join(f'def "p{k}" (inherits = </r/c{level + 1}>) {{}}' for k in range(20))
                + "\n}"
                for level in range(6)
            )
            + '\nclass "c6" {}\ndef "all" (inherits = </r/c0>) {}',
            [f"takes more than {MEMORY >> 20} MiB", "takes more than 2 s"],
        ),
    ],
)
def test_what_kills_the_helper_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, body: str, words: list[str]
) -> None:
    """Crashes and blow-ups end the helper, not this process, which says so; then all is well."""
    monkeypatch.setattr(asset_trial, "CPU_SECONDS", 2)
    text = refusal(written(tmp_path / "a.usda", body))
    assert "USD's reader" in text and any(word in text for word in words)
    assert text.endswith("undo the last edit, or export it again")
    assert len(load_robot().actuators) == 12


def test_an_endless_reader_is_stopped(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A helper that gives no answer in time is killed, and the file refused."""
    load_robot(_copy(tmp_path / "b.usda"))
    monkeypatch.setattr(asset_trial, "WALL_SECONDS", 0.2)
    helper = asset_trial._helper
    assert helper is not None
    os.kill(helper.pid, signal.SIGSTOP)
    monkeypatch.setattr(asset_trial, "start_helper", lambda: pytest.fail("a second helper"))
    assert "USD's reader takes more than 20 s with it" in refusal(_copy(tmp_path / "a.usda"))
    assert helper.returncode == -signal.SIGKILL


def test_a_helper_that_left_is_replaced(tmp_path: Path) -> None:
    """A helper that ended since the last file is no reason to refuse the next one."""
    copy = _copy(tmp_path / "a.usda")
    load_robot(_copy(tmp_path / "b.usda"))
    assert asset_trial._helper is not None
    asset_trial._helper.kill()
    assert len(load_robot(copy).actuators) == 12


def test_a_forked_process_has_a_helper_of_its_own(tmp_path: Path) -> None:
    """Two processes must not read each other's answers."""
    load_robot(_copy(tmp_path / "a.usda"))
    before = asset_trial._helper
    assert before is not None
    pid = os.fork()
    if pid == 0:
        code = 1
        try:
            separate = asset_trial._helper is None
            load_robot(_copy(tmp_path / "b.usda"))
            code = 0 if separate and asset_trial._helper is not None else 1
            asset_trial.stop()
        finally:
            os._exit(code)
    assert os.waitpid(pid, 0)[1] == 0
    assert asset_trial._helper is before and before.poll() is None


def _copy(path: Path) -> Path:
    path.write_bytes((ASSETS / "mr_go.usda").read_bytes())
    return path


def test_a_file_is_tried_once_until_it_or_a_layer_changes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Loading again costs a look at the files; a new text, of the file or of a sublayer, is tried again."""
    asked: list[str] = []
    answer = asset_trial.ask_helper
    monkeypatch.setattr(asset_trial, "ask_helper", lambda request: asked.append(request["file"]) or answer(request))
    below = tmp_path / "below.usda"
    below.write_text('#usda 1.0\nover "mr_go" {}\n', encoding="utf-8")
    path = tmp_path / "a.usda"
    text = (ASSETS / "mr_go.usda").read_text(encoding="utf-8")
    path.write_text(
        text.replace('    defaultPrim = "mr_go"', '    defaultPrim = "mr_go"\n    subLayers = [@./below.usda@]'),
        encoding="utf-8",
    )
    load_robot(path)
    load_robot(path, payload=3)
    assert len(asked) == 1
    below.write_text('#usda 1.0\nover "mr_go"\n{\n    double x = 1\n}\n', encoding="utf-8")
    load_robot(path)
    assert len(asked) == 2


def test_refusals_come_in_the_words_of_the_helper(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Relative paths stay as they were given, wherever the helper was started."""
    load_robot()
    monkeypatch.chdir(tmp_path)
    written(tmp_path / "a.usda", "double x = ")
    with pytest.raises(AssetError, match=r"^a\.usda: not readable as USD"):
        load_robot("a.usda")
    answer = try_out(str(tmp_path), "a.usda")
    assert list(answer) == ["refused"] and answer["refused"].startswith("a.usda: not readable")


def test_a_file_of_an_impossible_size_is_refused(tmp_path: Path) -> None:
    """Size first, without reading it."""
    path = tmp_path / "a.usda"
    with path.open("wb") as file:
        file.truncate(MAX_BYTES + 1)
    assert f"{MAX_BYTES + 1} bytes; allowed: {MAX_BYTES}" in refusal(path)


def test_more_variants_than_anyone_can_try_are_refused(tmp_path: Path) -> None:
    """Ten sets of ten variants would be ten thousand million robots."""
    sets = [f'"s{k}"' for k in range(10)]
    body = "\n".join(f"variantSet {s} = {{ " + " ".join(f'"v{k}" {{}}' for k in range(10)) + " }" for s in sets)
    path = tmp_path / "a.usda"
    path.write_text(f'{HEAD}def "r" (add variantSets = [{", ".join(sets)}])\n{{\n{body}\n}}\n', encoding="utf-8")
    assert f"10000000000 combinations of variants; allowed: {MAX_CHOICES}" in refusal(path)
    with pytest.raises(AssetError, match="combinations of variants"):
        next(choices(open_here(path)))


@pytest.mark.parametrize("name", ["a" * 5000 + ".usda", "loop/x.usda"])
def test_references_that_are_no_file_names_are_refused(tmp_path: Path, name: str) -> None:
    """Too long a name, or links in a circle: refused with the place, not by the operating system."""
    (tmp_path / "loop").symlink_to(tmp_path / "loop")
    text = refusal(written(tmp_path / "a.usda", f'def "b" (references = @./{name}@) {{}}'))
    assert "is no file name; correct it" in text or "composition error" in text
