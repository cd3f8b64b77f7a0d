"""The default numbers are what ``--calibrate`` gives with the shipped policies: new policies need new numbers."""

import json
from pathlib import Path

import pytest

from mrwarp.cli import main
from mrwarp.energy.model_numbers import CALIBRATED, GROUPS

pytestmark = pytest.mark.slow


def test_defaults_come_from_the_shipped_policies(tmp_path: Path) -> None:
    """Electronics and winding from ``mrwarp walk``, housings and capacity from ``mrwarp mission``, all of Go1's walks.

    The defaults have three digits, so each is off by up to 0.2 %, and a later one follows from up to four others: 1 %.
    """
    walked, carried = tmp_path / "walk", tmp_path / "mission"
    assert main(["walk", "--calibrate", "--robot", "go1", "--out", str(walked)]) == 0
    numbers = str(walked / "numbers.json")
    assert main(["mission", "--calibrate", "--robot", "go1", "--numbers", numbers, "--out", str(carried)]) == 0
    found = json.loads((carried / "numbers.json").read_text())
    for group, names in CALIBRATED.items():
        for name in names:
            assert found[group][name] == pytest.approx(getattr(GROUPS[group](), name), rel=0.01), name
