"""The runner: what changed is made again, failures stay alone, a stopped run goes on, damaged results are not used."""

import json
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np
import pytest

from mrwarp.paper import PaperValue
from paper.reproduce import cache
from paper.reproduce.cache import KEPT, Experiment, Job, Runner
from paper.reproduce.comparison import Comparison, Findings
from paper.reproduce.settings import NotYet, Settings, over_seeds, seeds_of

CALLS: list[str] = []


@pytest.fixture(autouse=True)
def _forget() -> None:
    CALLS.clear()


def base(job: Job) -> Findings:
    """Leaves a file that others read."""
    CALLS.append("base")
    (job.out / "data.txt").write_text(str(job.settings.seed))
    return Findings()


def reader(job: Job) -> Findings:
    """Reads it."""
    CALLS.append("reader")
    value = float((job.out.parent / "base" / "data.txt").read_text())
    return Findings(
        rows=[Comparison(condition="c", quantity="x", unit="m", paper=PaperValue(mean=1.0, sd=0.5), ours=value)]
    )


def failing(job: Job) -> Findings:
    """Always fails."""
    CALLS.append("failing")
    raise RuntimeError("no\nluck")


def waiting(job: Job) -> Findings:
    """Its input is not there yet."""
    raise NotYet("no policies yet")


def catalogue(*functions) -> dict[str, Experiment]:
    """Experiments of these functions; ``base`` depends on the seed, all others on ``base``."""
    return {
        f.__name__: Experiment(
            name=f.__name__,
            compute=f,
            needs=() if f is base else ("base",),
            settings=("seed",) if f is base else (),
        )
        for f in (base, *functions)
    }


def run(out: Path, *functions, settings: Settings | None = None) -> Runner:
    """Run all of them."""
    runner = Runner(catalogue=catalogue(*functions), settings=settings or Settings(), out=out)
    runner.run([f.__name__ for f in functions])
    return runner


def test_runner_makes_only_what_changed(tmp_path: Path) -> None:
    """A repeated run keeps everything; another setting makes its dependants again, and theirs."""
    first = run(tmp_path, reader).outcomes
    again = run(tmp_path, reader).outcomes
    assert CALLS == ["base", "reader"]
    assert [o.status for o in first.values()] == ["made", "made"]
    assert [o.status for o in again.values()] == ["kept", "kept"]
    assert again["reader"].findings == first["reader"].findings
    assert again["reader"].processor == first["reader"].processor > 0.0
    run(tmp_path, reader, settings=Settings(impacts=3))
    assert len(CALLS) == 2  # neither depends on the impacts
    run(tmp_path, reader, settings=Settings(seed=1))
    assert CALLS[2:] == ["base", "reader"]


def test_the_time_of_what_is_not_kept_is_reported_beforehand(tmp_path: Path) -> None:
    """All of it at first, nothing when all is kept, the dependants of a changed setting; nothing is run for it."""

    def left(settings: Settings | None = None) -> dict[str, float]:
        parts = catalogue(reader, waiting)
        parts["base"] = replace(parts["base"], seconds=lambda settings: 2.0 * settings.impacts)
        parts["waiting"] = replace(parts["waiting"], files=needed)
        return Runner(catalogue=parts, settings=settings or Settings(), out=tmp_path).estimate(["reader", "waiting"])

    def needed() -> list[Path]:
        raise NotYet("no policies yet")

    assert left() == {"base": 24.0, "reader": 1.0} and not CALLS
    run(tmp_path, reader)
    assert left() == {}
    assert left(Settings(seed=1, impacts=3)) == {"base": 6.0, "reader": 1.0}


def test_runner_makes_it_again_when_the_code_or_an_input_changed(tmp_path: Path, monkeypatch) -> None:
    """The hash of the code and of the files belongs to the key."""
    run(tmp_path, reader)
    real = cache.code_hash
    monkeypatch.setattr(cache, "code_hash", lambda modules, **without: real(modules, **without) + "x")
    run(tmp_path, reader)
    assert CALLS == ["base", "reader"] * 2
    data = tmp_path / "input"
    hashes = []
    monkeypatch.undo()
    for text in ("a", "b"):
        data.write_text(text)
        experiment = replace(catalogue()["base"], files=lambda: (data,))
        hashes.append(experiment.key(Settings(), {}))
    assert hashes[0]["rests_on"] != hashes[1]["rests_on"]


def test_one_failure_loses_nothing_else(tmp_path: Path) -> None:
    """The others are made; the failed one says why on one line, keeps its traceback and is tried again."""
    outcomes = run(tmp_path, failing, waiting, reader).outcomes
    assert {name: o.status for name, o in outcomes.items()} == {
        "base": "made",
        "failing": "failed",
        "waiting": "waiting",
        "reader": "made",
    }
    assert outcomes["failing"].message == "no luck"
    assert "RuntimeError" in (tmp_path / "failing" / "error.txt").read_text()
    assert outcomes["waiting"].message == "no policies yet"
    run(tmp_path, failing, reader)
    assert CALLS == ["base", "failing", "reader", "failing"]


def test_what_needs_a_failed_experiment_is_not_run(tmp_path: Path) -> None:
    """It says which one, and its own function is never called."""
    both = catalogue(failing, reader)
    both["reader"] = replace(both["reader"], needs=("failing",))
    runner = Runner(catalogue=both, settings=Settings(), out=tmp_path)
    runner.run(["reader"])
    assert runner.outcomes["reader"].status == "failed"
    assert runner.outcomes["reader"].message == "needs failing: no luck"
    assert "reader" not in CALLS


def test_a_stopped_run_goes_on(tmp_path: Path) -> None:
    """Ctrl-C leaves what was done, and the next run makes the rest."""

    def stopped(job: Job) -> Findings:
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        run(tmp_path, stopped)
    assert run(tmp_path, reader).outcomes["base"].status == "kept"


def test_a_result_that_is_made_anew_is_gone_until_it_is(tmp_path: Path) -> None:
    """Its data may be another key's by the time it breaks off, so going back to the old key makes it again."""
    breaks = []

    def breaking(job: Job) -> Findings:
        (job.out / "data.txt").write_text(str(job.settings.seed))
        if breaks:
            raise RuntimeError("no luck")
        return Findings()

    parts = catalogue(breaking)
    parts["breaking"] = replace(parts["breaking"], needs=(), settings=("seed",))

    def status(seed: int) -> str:
        runner = Runner(catalogue=parts, settings=Settings(seed=seed), out=tmp_path)
        runner.run(["breaking"])
        return runner.outcomes["breaking"].status

    assert status(0) == "made"
    breaks.append(True)
    assert status(1) == "failed"
    breaks.clear()
    assert status(0) == "made"
    assert (tmp_path / "breaking" / "data.txt").read_text() == "0"


@pytest.mark.parametrize("damage", ["", "{", "[]", '{"key": 1}', "null", '{"key": {}, "findings": {}, "seconds": 1}'])
def test_a_damaged_result_is_made_again(tmp_path: Path, damage: str) -> None:
    """With any content of the file, nothing of it is used."""
    run(tmp_path, reader)
    (tmp_path / "reader" / KEPT).write_text(damage)
    assert run(tmp_path, reader).outcomes["reader"].status == "made"


def test_findings_survive_json() -> None:
    """Rows, spreads and tables come back equal; a missing figure comes back as no number."""
    rows = [
        Comparison(
            condition="a", quantity="b", unit="", paper=PaperValue(mean=1.0), ours=2.0, sd=0.1, n=3, why="because"
        ),
        Comparison(condition="a", quantity="b", unit="", paper=None, ours=3.0, calibrated=True),
    ]
    found = Findings(rows=rows, claims={"yes": True}, notes=["n"], pictures={"a.png": "c"}, figures={"x": [1.0]})
    assert cache.typed(json.loads(json.dumps(asdict(found))), Findings) == found


def test_order_puts_needs_first(tmp_path: Path) -> None:
    """Each experiment stands once, after what it needs; an unknown name is an error."""
    runner = Runner(catalogue=catalogue(reader, waiting), settings=Settings(), out=tmp_path)
    runner.run(["waiting", "reader"])
    assert list(runner.outcomes) == ["base", "waiting", "reader"]
    with pytest.raises(KeyError):
        runner.run(["nothing"])


def test_code_hash_counts_what_a_figure_can_depend_on(tmp_path: Path) -> None:
    """Words do not count; a constant of a module imported in a function does, but not one for types alone."""
    root = tmp_path / "pack"
    (root / "laws").mkdir(parents=True)
    first_a = '"""A."""\ndef f():\n    """F."""\n    from pack import b\n    return b.X\n\nCLAIMS = ("one",)\n'
    texts = {"__init__": "", "a": first_a, "b": "X = 1\n", "c": "Y = 1\n", "laws/l": "Z = 1\n"}

    def now(*more: str, without: tuple[str, ...] = (), **changed: str) -> str:
        for name, text in {**texts, **changed}.items():
            (root / f"{name}.py").write_text(text)
        cache._parse.cache_clear()
        return cache.code_hash(("pack.a", *more), tmp_path, ("pack",), without=without)

    same = (
        first_a.replace("A.", "B.").replace("F.", "G.").replace("one", "two").replace("return b.X", "return (b.X)  # x")
    )
    types = f"from typing import TYPE_CHECKING\n{first_a}"
    assert now() == now(a=same, c="Y = 2\n")
    assert now(a=types) == now(a=f"{types}if TYPE_CHECKING:\n    from pack import c\n", c="Y = 2\n")
    assert now() != now(b="X = 2\n") and now() != now(a=first_a.replace("b.X", "-b.X"))
    assert now(without=("pack.b",)) == now(without=("pack.b",), b="X = 2\n")
    loaded = {**texts, "laws/l": "Z = 2\n"}
    assert now() == now(**loaded) and now("pack.laws") != now("pack.laws", **loaded)


def test_rollouts_are_averaged_within_each_seed_first() -> None:
    """Section 6.2: three seeds are three values, one that is left of them is one; a single policy's rollouts stay."""
    values = [1.0, 10.0, 100.0, 3.0, 30.0, 300.0]
    found = over_seeds(values, seeds_of(np.arange(6), 3))
    assert (found["ours"], found["n"]) == (pytest.approx((2.0 + 20.0 + 200.0) / 3.0), 3)
    left = over_seeds(values, seeds_of(np.arange(6) * 3, 3))
    assert (left["ours"], left["sd"], left["n"]) == (pytest.approx(74.0), None, 1)
    single = over_seeds(values, seeds_of(np.arange(6), 1))
    values[0] = np.nan
    assert over_seeds(values, seeds_of(np.arange(6), 3))["n"] == 3
    assert over_seeds(values)["n"] == 5
    assert (single["ours"], single["n"]) == (pytest.approx(74.0), 6)


@dataclass
class Pair:
    """Some data."""

    x: np.ndarray
    name: str


@dataclass
class Data:
    """Nested data."""

    pairs: list[Pair]
    by_name: dict[str, dict[str, Pair]]
    empty: np.ndarray
    missing: np.ndarray | None


def test_store_returns_what_was_saved(tmp_path: Path) -> None:
    """Arrays bit for bit with their types, dataclasses wherever a field, a list or a dict holds them."""
    x = np.arange(3, dtype=np.int32)
    pair = Pair(x=x, name="a")
    data = Data(pairs=[pair], by_name={"b": {"c": pair}}, empty=np.zeros((2, 0)), missing=None)
    cache.save(tmp_path / "d.npz", data)
    found = cache.load(tmp_path / "d.npz", Data)
    for kept in (found.pairs[0], found.by_name["b"]["c"]):
        assert kept.name == "a" and kept.x.dtype == np.int32
        np.testing.assert_array_equal(kept.x, x)
    assert found.empty.shape == (2, 0) and found.missing is None
    assert [path.name for path in tmp_path.iterdir()] == ["d.npz"]


def test_store_refuses_objects(tmp_path: Path) -> None:
    """A file with pickled objects is not loaded."""
    np.savez(tmp_path / "d.npz", tree=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="pickle"):
        cache.load(tmp_path / "d.npz", Data)
