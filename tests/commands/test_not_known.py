"""A device of which nobody stated coil or mass: what hangs on them is left out or refused, never the paper's."""

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch
from pxr import Usd

from mrwarp.cli import main
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.model_file import Model, Parameter, load_model, save_model, stated
from mrwarp.robots.fit_device import stronger
from mrwarp.trials.mission import heat_of_devices
from mrwarp.trials.power_meter import coil_loss
from mrwarp.usd.asset import load_robot, with_model
from mrwarp.usd.open_stage import ASSETS
from tests.messages import Refused
from tests.models import LOOP, model_of

STATED = {
    "coil_resistance": Parameter(value=30.0, unit="Ohm", source="given as --coil-resistance"),
    "device_mass": Parameter(value=1.2, unit="kg", source="given as --device-mass"),
}


def brake(**changes: float) -> Model:
    """A brake of 4 N·m at 0.8 A."""
    values = dict(zip(LOOP, (0.0, 0.02, 0.0, 0.0, 15.0, 500.0, 0.0, 70.0, 30.0), strict=True))
    return model_of({**values, **changes}, source="brake", rate=500.0, current=(0.0, 0.8))


def test_a_file_keeps_what_was_stated(tmp_path: Path) -> None:
    """With its source; a file without is written as before, key by key, and both are read."""
    known = stated(brake(), STATED)
    assert load_model(save_model(known, tmp_path / "known.json")) == known
    text = save_model(brake(), tmp_path / "plain.json").read_text()
    assert load_model(tmp_path / "plain.json") == brake() and "source" not in text.partition('"fitted_on"')[0]
    assert "device_mass" not in text


@pytest.mark.parametrize(
    ("entry", "said"),
    [
        ('{"value": -1, "unit": "kg", "ci95": null}', "device_mass.value = -1; allowed: above 0, at most 100 kg"),
        ('{"value": 900, "unit": "g", "ci95": null}', "device_mass.unit = 'g'; allowed: 'kg'"),
        ("1.2", "device_mass = 1.2; allowed: an object"),
    ],
)
def test_a_mass_that_makes_no_sense(entry: str, said: str, tmp_path: Path, refused: Refused) -> None:
    """Refused by its place, before an engine is loaded."""
    path = save_model(brake(), tmp_path / "model.json")
    path.write_text(path.read_text().replace('"effects"', f'"device_mass": {entry}, "effects"'))
    assert said in refused("impact", "--model", path)


def test_a_robot_carries_it(tmp_path: Path) -> None:
    """Through ``asset apply`` and back; a device of twice the size weighs twice as much."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", tmp_path / "robot.usda"))
    for model, resistance, missing in (
        (brake(), 0.0, ("coil resistance", "mass")),
        (stated(brake(), STATED), 30.0, ()),
    ):
        path = save_model(model, tmp_path / "model.json")
        assert main(["asset", "apply", str(robot), str(path)]) == 0
        legs = [a for a in load_robot(robot).actuators if a.mr]
        assert {leg.mr.coil.coil_resistance for leg in legs if leg.mr} == {resistance}
        assert {leg.not_known for leg in legs} == {missing} and not any(leg.is_paper_device for leg in legs)
    assert main(["asset", "export", str(robot), "--out", str(tmp_path / "back.json")]) == 0
    back = load_model(tmp_path / "back.json")
    assert back.parameters["coil_resistance"] == STATED["coil_resistance"] and back.device_mass == STATED["device_mass"]
    _, double = stronger(back.to_params(), back, 2.0)
    assert double is not None and double.device_mass is not None and double.device_mass.value == 2.4


def test_a_robot_of_an_earlier_version_has_no_paper_coil(tmp_path: Path) -> None:
    """Its attribute says 4 Ohm next to a model that states none: nobody measured that; a number set by hand counts."""
    robot = Path(shutil.copy(ASSETS / "mr_go.usda", tmp_path / "robot.usda"))
    assert main(["asset", "apply", str(robot), str(save_model(brake(), tmp_path / "model.json"))]) == 0
    stage = Usd.Stage.Open(str(robot))
    found = next(prim for prim in stage.TraverseAll() if prim.GetName() == "MRDevice")
    found.GetAttribute("newton:mr:coil_resistance").Set(4.0)
    found.GetAttribute("mr:model:record").Set(
        found.GetAttribute("mr:model:record").Get().replace('"coil_resistance":0.0', '"coil_resistance":4.0')
    )
    stage.Save()
    assert {a.not_known for a in load_robot(robot).actuators if a.mr} == {("coil resistance", "mass")}
    assert main(["asset", "set", str(robot), "MRDevice", "coil_resistance", "30"]) == 0
    assert {a.not_known for a in load_robot(robot).actuators if a.mr} == {("mass",)}


def test_coils_of_unknown_resistance_take_nobody_knows_what() -> None:
    """Nothing without a current."""
    loss = coil_loss(torch.tensor([[0.0, 0.5], [0.8, 0.8]]), torch.tensor([[0.0, 30.0], [0.0, 30.0]]))
    np.testing.assert_allclose(loss.numpy(), [[0.0, 7.5], [np.nan, 19.2]], rtol=1e-6)


def test_heat_capacity_follows_from_the_mass() -> None:
    """Taken as steel; what is given wins; the paper's device keeps what is assumed for it."""
    paper, heat = [a for a in load_robot().actuators if a.mr], ThermalCfg()
    assert heat_of_devices(paper, heat) == (heat, ())
    devices = [a for a in with_model(load_robot(), stated(brake(), STATED)).actuators if a.mr]
    found, missing = heat_of_devices(devices, heat)
    assert found.fluid_capacity == pytest.approx(460.0 * 1.2) and [name[:15] for name in missing] == ["heat resistance"]
    given = replace(heat, fluid_capacity=500.0, fluid_resistance=2.0)
    assert heat_of_devices(devices, given) == (given, ())
