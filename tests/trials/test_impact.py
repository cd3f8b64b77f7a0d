"""Impact trials: paired copies, the push and the falling mass as they should be, figures and the command."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from mrwarp.cli import main
from mrwarp.env.cfg import TaskCfg
from mrwarp.params import ParameterError
from mrwarp.rl.policy import DEFAULT_POLICY, OnnxPolicy
from mrwarp.trials.falling_mass import MassCfg
from mrwarp.trials.impact import ImpactCfg, ImpactKind, ImpactSweep, ImpactTrace, Variant
from mrwarp.trials.impact_figures import THRESHOLDS, figures, paired_change, threshold_variants
from tests.trials.made_trace import trace
from tests.viewing.conftest import Recorded

SCALARS = "Scalars:scalars"
"""rerun's component of a time series."""


def make_cfg(**changes) -> ImpactCfg:
    """A small sweep: two trials, three currents, damping branch alone."""
    env = TaskCfg()
    env = replace(env, holding=False)
    variants = tuple(Variant(current=current) for current in (0.0, 0.0, 1.5))
    return ImpactCfg(**{"variants": variants, "trials": 2, "warmup": 1.0, "window": 0.4, "env": env, **changes})


@pytest.fixture(scope="module")
def policy() -> OnnxPolicy:
    """The shipped walking policy."""
    return OnnxPolicy(DEFAULT_POLICY)


@pytest.fixture(scope="module")
def push(policy: OnnxPolicy) -> ImpactTrace:
    """A push of 100 N, with the current 0 A twice."""
    return ImpactSweep(make_cfg(), policy).run()


def test_copies_with_the_same_current_are_bit_equal(push: ImpactTrace) -> None:
    """Only the current differs between settings: with the same current, every sample is the same number."""
    for name in ("height", "velocity", "tau_motor", "tau_mr", "f_foot", "q"):
        series = getattr(push, name)
        np.testing.assert_array_equal(series[0], series[1])
    assert (push.height[0] != push.height[2]).any()


def test_copies_are_equal_until_the_current_acts(push: ImpactTrace) -> None:
    """All settings start from the same state: the first sample differs by one step's acceleration at most."""
    # one 5 ms step of a 4 N·m difference on a calf of 0.015 kg m^2 moves it by 4/0.015*0.005^2 = 7 mrad
    np.testing.assert_allclose(push.q[0, :, 0], push.q[2, :, 0], atol=7e-3)


def test_without_current_no_coil_carries_any(push: ImpactTrace) -> None:
    """Coil current is 0 in the 0 A setting and reaches 1.5 A in the other."""
    assert push.current[0].max() == 0.0
    assert push.current[2].max() == pytest.approx(1.5)


def test_push_lowers_the_robot_and_ends(push: ImpactTrace, policy: OnnxPolicy) -> None:
    """100 N for 0.2 s lower the trunk more than walking does; after the trial no force is left."""
    calm = ImpactSweep(make_cfg(force=(0.0, 0.0, 0.0)), policy).run()
    assert push.height[0].min(axis=1).max() < calm.height[0].min(axis=1).min() - 0.01
    sweep = ImpactSweep(make_cfg(), policy)
    sweep.run()
    assert float(sweep.env.view(sweep.env.sim.backend.field("xfrc_applied")).abs().max()) == 0.0


def test_a_push_may_differ_between_robots_that_walked_in_once(push: ImpactTrace, policy: OnnxPolicy) -> None:
    """Begun again, or where the last one had its onset, a run has the same bits; own forces push each robot its way."""
    sweep = ImpactSweep(make_cfg(), policy)
    for again in (False, False, True):
        np.testing.assert_array_equal(sweep.run(again=again).height, push.height)
    sweep.forces[:] = np.array([[50.0, 0.0, 0.0], [-50.0, 0.0, 0.0]] * 3)
    speed = sweep.run(again=True).qpos[0, :, 0]
    sweep.forces[0] = sweep.forces[1]
    assert speed[-1] - sweep.run(again=True).qpos[0, -1, 0] > 0.1


def test_trials_differ_in_gait_phase(push: ImpactTrace) -> None:
    """The trials of one setting are hit at different gait phases, so their heights differ."""
    assert abs(push.height[0, 0] - push.height[0, 1]).max() > 1e-3


def test_falling_mass_arrives_with_the_papers_speed(policy: OnnxPolicy) -> None:
    """The guided mass meets the back at about 1.5 m/s and stops after 0.05 m."""
    cfg = make_cfg(kind=ImpactKind.DROP, window=0.6)
    sweep = ImpactSweep(cfg, policy)
    mass = sweep.mass
    assert mass is not None
    speeds, heights = [], []

    def watch(time: float) -> None:
        speeds.append(torch.where(mass.touched, torch.nan, mass.speed))
        heights.append(mass._qpos[:, mass._q[2]].clone())

    sweep.watchers.append(watch)
    trace = sweep.run()
    speed = torch.stack(speeds)
    arrival = torch.where(speed.isnan(), -torch.inf, speed).max(dim=0).values
    # the robot's back moves while the mass falls: +-0.03 m of 0.30 m change v = sqrt(2*a*s) by 5 %
    np.testing.assert_allclose(arrival.numpy(), 1.5, rtol=0.08)
    assert bool(mass.touched.all())
    height = torch.stack(heights)
    at_contact = torch.stack([height[int((~s.isnan()).sum()), e] for e, s in enumerate(speed.T)])
    # the travel stop is a soft joint limit
    np.testing.assert_array_less((at_contact - height.min(dim=0).values).numpy(), cfg.mass.travel + 0.015)
    assert trace.velocity.min() < -0.3


def test_guide_friction_turns_free_fall_into_the_contact_speed() -> None:
    """m*v^2/2 = (m*g - F)*s for the guide's friction F."""
    cfg = MassCfg()
    work = (cfg.mass * 9.81 - cfg.guide_friction) * cfg.drop
    assert work == pytest.approx(0.5 * cfg.mass * cfg.contact_speed**2)


def test_figures_of_a_made_up_trace() -> None:
    """Minimum, peak speed, drop and paired change of series whose answer is known."""
    t = np.arange(1, 41) * 0.005
    dip = np.array([[0.10, 0.12], [0.08, 0.09]])
    height = 0.33 - dip[..., None] * np.sin(np.pi * t / 0.2)
    made = trace(
        (2, 2, 40),
        height=height,
        velocity=-5.0 * dip[..., None] * np.ones(40),
        tau_motor=np.full((2, 2, 40, 4), 3.0),
    )
    found = figures(made, (0.0, 1.5))
    first, last = found["by_current"]
    assert first["min_height"]["mean"] == pytest.approx(0.33 - 0.11)
    assert last["peak_down_velocity"]["mean"] == pytest.approx(-0.425)
    assert first["motor_mean"]["FL"]["mean"] == pytest.approx(3.0)
    assert found["monotone"] == {"min_height": True, "peak_down_velocity": True}
    assert found["change"]["peak_down_velocity"]["percent"] == pytest.approx(100 * (0.085 - 0.11) / 0.11)


def test_each_setting_may_have_its_own_duration_gains_and_phase(policy: OnnxPolicy) -> None:
    """A setting that pushes for 0.1 s gives the bits of a sweep that does; the clock at onset is the one asked for."""
    both = make_cfg(
        variants=(Variant(current=0.0, duration=0.1), Variant(current=0.0)),
        duration=0.3,
        phases=(0.0, 0.5),
        gains=(25.0, 0.5),
    )
    sweep = ImpactSweep(both, policy)
    trace = sweep.run()
    # random poses depend on the size of the batch: the other sweep has as many settings
    alone = ImpactSweep(replace(both, variants=both.variants[1:] * 2, duration=0.1), policy).run()
    np.testing.assert_array_equal(trace.height[0], alone.height[0])
    assert (trace.height[0] != trace.height[1]).any()
    onset = (sweep.env.phase - both.window * sweep.env.cfg.gait_frequency).remainder(1.0).numpy()
    np.testing.assert_allclose(onset, [0.125, 0.375] * 2, atol=1e-4)
    assert set(sweep.env.view(sweep.env.actuator.kp).unique().tolist()) == {25.0}
    assert set(sweep.env.view(sweep.env.actuator.param("kd")).unique().tolist()) == {0.5}


def test_paired_change_interval_covers_the_truth() -> None:
    """The 95 % interval over 20 pairs covers a known mean change in 90 to 99 % of 300 draws."""
    rng = np.random.default_rng(3)
    covered = 0
    for _ in range(300):
        first = 1.0 + 0.2 * rng.standard_normal(20)
        found = paired_change(first, first + 0.1 + 0.05 * rng.standard_normal(20))
        covered += found["ci95"][0] <= 10.0 / first.mean() <= found["ci95"][1]
    assert 0.90 <= covered / 300 <= 0.99


def test_variant_parameters_reach_their_own_trials(policy: OnnxPolicy) -> None:
    """From the onset on a setting's threshold stands in its rows of the actuator's parameters and nowhere else."""
    variants = (Variant(current=1.0), Variant(current=1.0, params={"eps_v": 0.3}))
    sweep = ImpactSweep(make_cfg(variants=variants, warmup=0.1), policy)
    np.testing.assert_allclose(sweep.env.actuator.param("eps_v").numpy(), 0.2)
    sweep.run()
    eps_v = sweep.env.actuator.param("eps_v").numpy()
    np.testing.assert_allclose(eps_v[:2], 0.2)
    np.testing.assert_allclose(eps_v[2:], 0.3)
    with pytest.raises(ParameterError, match="allowed: 0 to 100"):
        make_cfg(variants=(Variant(current=1.0, params={"eps_v": -0.3}),))


def test_a_device_that_differs_walks_in_like_the_others(policy: OnnxPolicy) -> None:
    """Without drag from the onset on, a copy without current begins where the others do, and moves differently."""
    free = {"D": 0.0, "B": 0.0, "C": 0.0, "K0": 0.0}
    trace = ImpactSweep(make_cfg(variants=(Variant(current=0.0), Variant(current=0.0, params=free))), policy).run()
    np.testing.assert_allclose(trace.q[0, :, 0], trace.q[1, :, 0], atol=7e-3)
    assert (trace.q[0] != trace.q[1]).any()


def test_trials_walk_in_once_for_several_sweeps(policy: OnnxPolicy) -> None:
    """A sweep that begins with another's robots goes on as that one does, to the rounding of a smaller batch."""
    for kind in ImpactKind:
        cfg = make_cfg(kind=kind, warmup=0.4)
        walker, sweep = ImpactSweep(replace(cfg, variants=cfg.variants[:1]), policy), ImpactSweep(cfg, policy)
        with pytest.raises(ValueError, match="walked in with 2 trials"):
            sweep.begin_with(walker)
        alone = walker.run()
        sweep.begin_with(walker)
        # contacts make 1e-6 m of one rounding within a second; tenfold, for a processor that rounds otherwise
        np.testing.assert_allclose(sweep.run(again=True).height[0], alone.height[0], rtol=0, atol=1e-5)


def test_a_pad_softens_the_impact(policy: OnnxPolicy) -> None:
    """Through a spring of 5.5 kN/m the mass still meets every robot, and decelerates the trunk by less at most."""
    hardest = []
    for stiffness in (None, 5500.0):
        cfg = make_cfg(kind=ImpactKind.DROP, warmup=0.4, mass=MassCfg(stiffness=stiffness))
        trace = ImpactSweep(cfg, policy).run()
        assert np.isfinite(trace.contact).all()
        hardest.append(np.abs(np.diff(trace.velocity, axis=2)).max() / 0.005)
    assert hardest[1] < 0.7 * hardest[0]


def test_threshold_variants_cover_the_papers_values() -> None:
    """One reference without current, then every value of every threshold, one at a time."""
    rows = threshold_variants(1.5)
    assert rows[0] == Variant(current=0.0)
    assert [row.params for row in rows[1:]] == [{n: v} for n, values in THRESHOLDS.items() for v in values]


def test_command_writes_figures_pictures_and_the_same_minima_as_the_recording(tmp_path: Path) -> None:
    """``mrwarp impact --rrd``: result.json, pictures, and a recording whose series have the minima it states."""
    out, rrd = tmp_path / "out", tmp_path / "impact.rrd"
    argv = ["--out", str(out), "--trials", "2", "--current", "0", "1.5", "--coupling", "constraint", "--rrd", str(rrd)]
    assert main(["impact", *argv]) == 0
    result = json.loads((out / "result.json").read_text())
    assert set(result) >= {"couplings", "paper_change", "shown", "seed", "versions", "command"}
    for name in ("impact_constraint.png", "loops_constraint.png", "timeline_constraint.png"):
        assert (out / name).stat().st_size > 10_000
    recorded = Recorded(rrd)
    for row in result["shown"]:
        root = f"/robots/{row['robot']}"
        for series in ("calf_motor_torque", "mr_torque", "coil_current", "energy"):
            assert sum(1 for _ in recorded.columns(f"{root}/series/{series}", SCALARS)) > 100
        assert sum(1 for _ in recorded.columns(f"{root}/body/trunk", "Transform3D:translation")) > 100
        for series, name in (("trunk_height", "min_height"), ("vertical_velocity", "peak_down_velocity")):
            # the recording starts one second before the impact
            values = [v[0] for t, v in recorded.columns(f"{root}/series/{series}", SCALARS) if t > 1_001_000_000]
            assert min(values) == pytest.approx(row[name], abs=1e-6)
