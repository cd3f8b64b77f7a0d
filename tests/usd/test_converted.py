"""The cache of converted stages: one conversion per stage, none for other devices, and no damaged entry is used."""

import os
from pathlib import Path

import mujoco
import numpy as np
import pytest
from pxr import Usd

from mrwarp.usd import converted as module
from mrwarp.usd.asset import load_bench
from mrwarp.usd.converted import Field, cache_folder, converted


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache in the test's own folder."""
    monkeypatch.setenv("WARP_CACHE_PATH", str(tmp_path))
    return tmp_path / "mrwarp"


@pytest.fixture
def conversions(monkeypatch: pytest.MonkeyPatch) -> list[Usd.Stage]:
    """The stages that Newton was given."""
    seen: list[Usd.Stage] = []
    convert = module.convert_stage
    monkeypatch.setattr(module, "convert_stage", lambda stage, ground: (seen.append(stage), convert(stage, ground))[1])
    return seen


def binary(model: mujoco.MjModel) -> bytes:
    """All numbers and names of a model."""
    content = np.empty(mujoco.mj_sizeModel(model), dtype=np.uint8)
    mujoco.mj_saveModel(model, None, content)
    return content.tobytes()


def bench(**values: float) -> Usd.Stage:
    """The torque bench with other values of attributes, by the end of their paths."""
    stage = load_bench().stage
    for prim in stage.TraverseAll():
        for name, value in values.items():
            if (attribute := prim.GetAttribute(name.replace("__", ":"))) and attribute.HasAuthoredValue():
                attribute.Set(value)
    return stage


def test_the_second_time_nothing_is_converted(conversions: list[Usd.Stage], cache: Path) -> None:
    """The kept model is the first one to the bit, and a ground is another model."""
    text, first = converted(bench(), False)
    again, second = converted(bench(), False)
    assert len(conversions) == 1 and again == text and binary(first) == binary(second)
    converted(bench(), True)
    assert len(conversions) == 2 and len(list(cache.iterdir())) == 2


def test_other_numbers_of_a_device_need_no_conversion(conversions: list[Usd.Stage]) -> None:
    """Nothing of a drive is in the model; a mass is, and so is the height of the ground."""
    converted(bench(), False)
    converted(bench(newton__mr__K1=3.0), False)
    assert len(conversions) == 1
    _, heavier = converted(bench(physics__mass=3.25), False)
    assert len(conversions) == 2 and 3.25 in heavier.body_mass
    for height in (0.0, 0.1):
        heights = np.full((5, 5), height, dtype=np.float32)
        converted(bench(), Field(heights=heights, cell=0.5, origins=np.zeros((1, 1, 3), dtype=np.float32)))
    assert len(conversions) == 4


@pytest.mark.parametrize("damage", ["flipped", "cut", "empty"])
def test_a_damaged_entry_is_made_again(damage: str, conversions: list[Usd.Stage], cache: Path) -> None:
    """It is not handed to MuJoCo, which may crash on it."""
    _, first = converted(bench(), False)
    (entry,) = cache.iterdir()
    content = bytearray(entry.read_bytes())
    content[len(content) // 2] ^= 1
    entry.write_bytes({"flipped": bytes(content), "cut": bytes(content[:-100]), "empty": b""}[damage])
    _, second = converted(bench(), False)
    assert len(conversions) == 2 and binary(first) == binary(second)
    converted(bench(), False)
    assert len(conversions) == 2


def test_the_cache_keeps_what_was_used_last(monkeypatch: pytest.MonkeyPatch, cache: Path) -> None:
    """With room for two entries the one that was not used for longest goes."""
    text, model = converted(bench(), False)
    (entry,) = cache.iterdir()
    monkeypatch.setattr(module, "CACHE_BYTES", int(2.5 * entry.stat().st_size))
    for name, age in (("old", 1000), ("new", 10)):
        module._keep(cache / f"{name}{module._SUFFIX}", text, model)
        os.utime(cache / f"{name}{module._SUFFIX}", (entry.stat().st_mtime - age,) * 2)
    module._keep(cache / f"last{module._SUFFIX}", text, model)
    left = {path.stem for path in cache.iterdir()}
    assert left == {entry.stem, "last"}


def test_without_a_folder_nothing_is_kept(
    monkeypatch: pytest.MonkeyPatch, conversions: list[Usd.Stage], cache: Path
) -> None:
    """A file where the folder belongs, and a user without a home, cost a conversion each time and no error."""
    cache.write_text("in the way")
    converted(bench(), False)
    converted(bench(), False)
    for name in ("WARP_CACHE_PATH", "XDG_CACHE_HOME"):
        monkeypatch.delenv(name, raising=False)

    def homeless(path: Path) -> Path:
        raise RuntimeError("no home")

    monkeypatch.setattr(Path, "expanduser", homeless)
    assert cache_folder() is None
    converted(bench(), False)
    assert len(conversions) == 3
