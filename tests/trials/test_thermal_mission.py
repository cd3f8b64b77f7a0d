"""The mission with devices that warm up: the model between windows, the inverse of eq. 18, what counts as a slip."""

import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import torch

from mrwarp.cli import main
from mrwarp.energy.power import ElectricalCfg, JointLoad
from mrwarp.energy.thermal import ThermalCfg
from mrwarp.params import HoldParams
from mrwarp.trials import thermal_mission
from mrwarp.trials.mission import MissionCfg

LOAD = JointLoad(
    torque_square=np.zeros(12),
    speed=np.zeros(12),
    work_out=np.zeros(12),
    work_in=np.zeros(12),
    coil=np.full(4, 1.5),
    friction=np.full(4, 0.5),
)


@pytest.fixture
def steady(monkeypatch: pytest.MonkeyPatch) -> None:
    """Windows and standing that heat each device by 2 W, at any temperature."""
    window = thermal_mission.Window(joints=LOAD, speed=0.3, slipped=0.0, short=0.0, need=np.full(20, 10.0))
    monkeypatch.setattr(thermal_mission, "walk_window", lambda *_: window)
    monkeypatch.setattr(thermal_mission, "standing_load", lambda *_, **__: (LOAD, {}))


@pytest.mark.usefixtures("steady")
def test_temperature_and_safety_factor_follow_the_closed_form() -> None:
    """Constant heat: 16 K·(1 - exp(-t/520 s)); the factor of 1.2 is used up where a sixth of the yield has gone."""
    heat = ThermalCfg(yield_coefficient=0.02)
    found = thermal_mission.run(MissionCfg(), lambda obs: obs, ElectricalCfg(), heat, 0.0)
    law = found["modes"]["law"]
    t, rise = np.array(law["trace"]["t"]), np.array(law["trace"]["rise"])
    assert t[-1] == pytest.approx(2 * 150.0 / 0.3 + 600.0)
    np.testing.assert_allclose(rise, 16.0 * (1.0 - np.exp(-t / 520.0)), rtol=1e-9)
    assert law["safety_factor_left"] == pytest.approx(1.2 * (1.0 - 0.02 * rise.max()))
    gone = -520.0 * np.log(1.0 - (1.0 / 6.0) / 0.02 / 16.0)
    assert gone < law["used_up_after"] < gone + 10.1
    assert found["modes"]["law_compensated"]["used_up_after"] is None
    assert found["modes"]["law_compensated"]["safety_factor_left"] == pytest.approx(1.2)
    hold = HoldParams()
    holds = hold.T_max * found["fixed_current"] ** hold.n / (hold.K**hold.n + found["fixed_current"] ** hold.n)
    assert holds == pytest.approx(1.2 * 10.0)


def test_no_compensation_holds_more_than_the_largest_current_does(monkeypatch: pytest.MonkeyPatch) -> None:
    """20 N·m: the device bears 25.3 N·m at 1.5 A; below 24/25.3 of its strength a compensated factor falls with it."""
    window = thermal_mission.Window(joints=LOAD, speed=0.3, slipped=0.0, short=0.0, need=np.full(20, 20.0))
    monkeypatch.setattr(thermal_mission, "walk_window", lambda *_: window)
    monkeypatch.setattr(thermal_mission, "standing_load", lambda *_, **__: (LOAD, {}))
    heat = ThermalCfg(yield_coefficient=0.02)
    found = thermal_mission.run(MissionCfg(), lambda obs: obs, ElectricalCfg(), heat, 0.0)["modes"]
    plain, raised = (np.array(found[mode]["trace"]["factor"]) for mode in ("fixed", "fixed_compensated"))
    strength = np.array(found["fixed"]["trace"]["strength"])
    np.testing.assert_allclose(plain, 1.2 * strength, rtol=1e-9)
    np.testing.assert_allclose(raised, np.minimum(1.2, strength * HoldParams().yield_torque(1.5) / 20.0), rtol=1e-9)
    assert found["fixed_compensated"]["used_up_after"] > found["fixed"]["used_up_after"] > 0.0


def test_a_hold_slips_where_a_still_joint_moves_under_more_than_the_device_bears() -> None:
    """Device 0 stops and is overloaded, device 1 slows down under overload, device 2 moves within its yield torque."""
    values = {"m_hold": torch.ones(1, 3), "current": torch.tensor([[0.3, 0.3, 1.5]]), "T_max": torch.full((1, 3), 26.6),
              "K": torch.full((1, 3), 0.513), "n": torch.full((1, 3), 2.88), "kp_base": torch.full((1, 3), 35.0),
              "kp_low": torch.full((1, 3), 5.0)}  # fmt: skip
    actuator = SimpleNamespace(mr_joints=(0, 1, 2), param=lambda name: name, m_hold="m_hold", current="current")
    env: Any = SimpleNamespace(
        actuator=actuator,
        view=values.__getitem__,
        qd=torch.zeros(1, 3),
        substep_hooks=[],
        q_des=torch.full((1, 3), 0.5),
        q=torch.zeros(1, 3),
    )
    values["m_hold"] *= 0.0
    meter = thermal_mission.HoldMeter(env)
    speeds = [(0.0, 0.0, 0.0), (0.1, 0.15, 0.1), (0.001, 0.1, 0.001), (0.001, 0.1, 0.0), (0.3, 0.3, 0.3), (0.3,) * 3]
    for k, speed in enumerate(speeds):
        values["m_hold"].fill_(float(k > 0))
        env.qd.copy_(torch.tensor([speed]))
        meter.count()
    assert meter.holds.tolist() == [[1.0, 1.0, 1.0]] and meter.held.tolist() == [[5.0, 5.0, 5.0]]
    assert meter.slips.tolist() == [[1.0, 0.0, 0.0]]
    assert meter.short.tolist() == [[5.0, 5.0, 0.0]]


@pytest.mark.usefixtures("steady")
def test_the_command_writes_table_and_picture(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """``mission --thermal``: all four modes; options that do not go with it are refused."""
    assert main(["mission", "--thermal", "--ambient", "20", "--out", str(tmp_path)]) == 0
    found = json.loads((tmp_path / "result.json").read_text())
    assert list(found["modes"]) == list(thermal_mission.MODES) and found["ambient"] == 20.0
    assert (tmp_path / "thermal.png").stat().st_size > 0
    assert list(found["missions"]) == ["seed 0", "seed 1", "seed 2"]
    law = found["missions"]["seed 0"]["modes"]["law"]
    rise = found["modes"]["law"]["rise"]
    assert rise["values"] == [law["rise"]] * 3 and rise["half_width"] == pytest.approx(0.0)
    for wrong in (["--ambient", "20"], ["--thermal", "--feedback"], ["--thermal", "--current-by", "scheduled"]):
        assert main(["mission", *wrong, "--out", str(tmp_path / "no")]) == 2
    assert not (tmp_path / "no").exists()
    assert "--ambient goes with --thermal" in capsys.readouterr().err
