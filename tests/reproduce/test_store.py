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


def test_store_returns_what_was_saved(tmp_path: Path) -> None:
    """Arrays bit for bit with their types, dataclasses as dicts, tuples as lists."""
    x = np.arange(3, dtype=np.int32)
    store.save(tmp_path / "d.npz", {"pairs": [Pair(x=x, name="a")], "empty": np.zeros((2, 0)), "n": (1, None)})
    found = store.load(tmp_path / "d.npz")
    assert found["pairs"][0]["name"] == "a"
    assert found["pairs"][0]["x"].dtype == np.int32
    np.testing.assert_array_equal(found["pairs"][0]["x"], x)
    assert found["empty"].shape == (2, 0)
    assert found["n"] == [1, None]
    assert [path.name for path in tmp_path.iterdir()] == ["d.npz"]


def test_store_refuses_objects(tmp_path: Path) -> None:
    """A file with pickled objects is not loaded."""
    np.savez(tmp_path / "d.npz", tree=np.array([{"a": 1}], dtype=object))
    with pytest.raises(ValueError, match="pickle"):
        store.load(tmp_path / "d.npz")
