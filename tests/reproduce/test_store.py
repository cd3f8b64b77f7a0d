"""Stored data: nested values come back equal, and nothing is ever unpickled."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from mrwarp.reproduce import store


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
    store.save(tmp_path / "d.npz", data)
    found = store.load(tmp_path / "d.npz", Data)
    for kept in (found.pairs[0], found.by_name["b"]["c"]):
        assert kept.name == "a" and kept.x.dtype == np.int32
        np.testing.assert_array_equal(kept.x, x)
    assert found.empty.shape == (2, 0) and found.missing is None
    assert [path.name for path in tmp_path.iterdir()] == ["d.npz"]


def test_store_refuses_objects(tmp_path: Path) -> None:
    """A file with pickled objects is not loaded."""
    np.savez(tmp_path / "d.npz", tree=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="pickle"):
        store.load(tmp_path / "d.npz", Data)
