"""The generator of hidden effects: its base, its levels, what is absent at null, its files, its suite."""

import dataclasses
import json
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import least_squares

from benchmarks.confusion import bench, levels
from benchmarks.confusion.case import NOISES, Case, Noise, Truth, make_case, write_case
from benchmarks.confusion.effects import CALIBRATION, EFFECTS, PAIRS, SINGLE, UNCATALOGUED, Effect
from benchmarks.confusion.families import FAMILIES, OTHER_LAWS, Plan
from benchmarks.confusion.levels import TOLERANCE
from benchmarks.confusion.motion import make_session
from benchmarks.confusion.path import behind_gap
from benchmarks.confusion.suite import SuiteError, run_case, run_suite
from benchmarks.confusion.tables import report
from benchmarks.confusion.truth import BASE, Device, Signals, simulate
from benchmarks.confusion.verdicts import judge, record_of
from mrwarp.effects.catalogue import CATALOGUE
from mrwarp.identify.replay import simulate as replay
from mrwarp.recording.load import Recording, load_recording

SIGMA = NOISES["realistic"].sigma
FLOOR = 0.05
"""Error of the simulator's kernels at one step per sample, as a share of the noise."""
ROUNDING = np.finfo(float).eps
SILENT = Noise(white=0.0, coloured=0.0, offset=0.0, gain=0.0, velocity=0.0, encoder=0.0)


def test_the_contract_is_complete() -> None:
    """Every token of the contract can be hidden, and what is outside says which variables count."""
    assert {*SINGLE, *CALIBRATION} == set(CATALOGUE) and len(CALIBRATION) == 4 and len(UNCATALOGUED) == 6
    assert len(PAIRS) == 6 and {name for pair in PAIRS for name in pair} <= set(SINGLE)
    assert {name for name in EFFECTS if EFFECTS[name].depends_on} == set(UNCATALOGUED)


@pytest.mark.parametrize("size", ["large", "small"])
def test_base_is_eqs_14_and_15(size: str) -> None:
    """Without effects and noise the log is what the simulator's kernels give, to their step at 200 Hz.

    At one step per sample they differ by a twentieth of the noise, which adds (0.05/0.4)²/2 = 0.8 % to a level of 0.4.
    Steps are of the second order but for reversals, which fill one each: more than of order 1.5.
    """
    case = make_case("none", level=0.0, seed=5, size=size)
    clean = case.record(case.motion, stream=9, noise=SILENT)
    values = {**case.device.base, "q_offset": case.device.zero}
    for substeps in (1, 2, 8):
        simulated = replay(values, clean, substeps=substeps)
        errors = [sim - run.torque for sim, run in zip(simulated, clean.trajectories, strict=True)]
        floor = float(np.sqrt(np.mean(np.concatenate(errors) ** 2)))
        print(f"{size}, {substeps} substeps: {floor:.6f} N·m RMS, {floor / SIGMA:.2%} of sigma")
        assert floor < FLOOR * substeps**-1.5 * SIGMA


@pytest.mark.parametrize("name", sorted(EFFECTS))
def test_null_changes_nothing(name: str) -> None:
    """At its null an effect leaves every channel as it is; slightly off, some channel moves."""
    motion = make_session(size="small", seed=np.random.SeedSequence([1, 0]))
    plain = Device.drawn(0.02, np.random.SeedSequence([1, 1]))
    spec = EFFECTS[name]
    draws = spec.draw(np.random.default_rng(3))

    def run(strength: float) -> Signals:
        return simulate(plain.with_effects({name: Effect(strength=strength, draws=draws)}), motion)

    null = 1.0 if name.endswith("_gain") and name in CALIBRATION else 0.0
    base, at_null, acting = simulate(plain, motion), run(null), run(null + spec.guess)
    for channel in ("q", "qd", "current", "torque"):  # a path that is stepped again is rounded in each step
        size = np.abs(getattr(base, channel)).max()
        rounded = motion.q.shape[1] * ROUNDING * size
        np.testing.assert_allclose(getattr(at_null, channel), getattr(base, channel), rtol=0.0, atol=rounded)
    assert any(np.abs(getattr(acting, c) - getattr(base, c)).max() > 1e-6 for c in ("q", "qd", "torque"))


STEPPED = ("backlash", "series_compliance", "path_lag")
"""Effects whose truth is stepped through the fine grid at every strength that is tried."""


@pytest.mark.parametrize(
    "name", [pytest.param(n, marks=[pytest.mark.slow] * (n in STEPPED)) for n in (*SINGLE, *UNCATALOGUED)]
)
def test_levels_come_out(name: str) -> None:
    """The level is the one that was asked for, and its strength is stated in a unit.

    A delay below one sample acts on the edges that fall into it: their energy jumps by one edge, the level by half.
    """
    case = make_case(name, level=0.4, seed=2, size="small")
    stated = case.truth.parameters[name]
    print(f"{name:20s} {stated['parameter']:14s} {stated['value']:11.4g} {stated['unit']:14s} level {case.level:.3f}")
    jumps = 0.0
    if name == "command_delay":
        plain, late = (simulate(d, case.motion).torque for d in (case.device.with_effects({}), case.device))
        jumps = 0.5 * float(((late - plain) ** 2).max() / ((late - plain) ** 2).sum())
    assert case.level == pytest.approx(0.4, rel=TOLERANCE + jumps)


@pytest.mark.parametrize("name", ["coulomb_friction", "coil_lag", "velocity_lag", "position_gain"])
def test_level_is_what_a_fit_of_the_simulator_leaves(name: str) -> None:
    """An independent fit (the simulator's kernels, trust region) of the noise-free log leaves the level.

    To what ends the benchmark's own refit, a share of the energy, and the error of the kernels at four steps.
    """
    case = make_case(name, level=0.4, seed=3, size="small")
    clean = case.record(case.motion, stream=9, noise=SILENT)
    measured = np.concatenate([run.torque for run in clean.trajectories])
    start = np.array([case.device.base[key] for key in BASE])

    def left(factors: np.ndarray) -> np.ndarray:
        values = {**dict(zip(BASE, start * factors, strict=True)), "q_offset": case.device.zero}
        return np.concatenate(replay(values, clean, substeps=4)) - measured

    fit = least_squares(left, np.ones(len(BASE)), diff_step=1e-3, x_scale="jac")
    left_out = 0.5 * levels._SETTLED * case.level + FLOOR * 4**-1.5
    assert np.sqrt(np.mean(fit.fun**2)) / SIGMA == pytest.approx(case.level, abs=left_out)


def test_calibration_leaves_nothing() -> None:
    """Shifts of calibration have a physical size and no level: (0.02/0.4)², what ends a refit, of the usual energy."""
    for name in CALIBRATION:
        case = make_case(name, level=0.4, seed=4, size="small")
        assert case.truth.parameters[name]["value"] == EFFECTS[name].size and case.level < 0.02


def test_seed_decides_everything() -> None:
    """One seed gives the same bits; another one another device, motion and noise."""
    one, same, other = (make_case("coil_lag", level=0.4, seed=seed, size="small") for seed in (7, 7, 8))
    for channel in ("t", "q", "qd", "current", "torque"):
        for a, b in zip(one.recording.trajectories, same.recording.trajectories, strict=True):
            np.testing.assert_array_equal(getattr(a, channel), getattr(b, channel))
    assert one.truth == same.truth and one.truth.base != other.truth.base
    assert not np.allclose(*(case.recording.trajectories[0].torque for case in (one, other)))


def test_noise_is_as_stated() -> None:
    """RMS of the noise is sigma (with zero and gain errors off), and the encoder has its step.

    To four standard errors: of the torque's noise, which has a colour, over the runs; of N white samples 1/sqrt(2N).
    """
    noise = dataclasses.replace(NOISES["realistic"], offset=0.0, gain=0.0)
    case = make_case("none", level=0.0, seed=9, noise=noise)
    clean = case.record(case.motion, stream=9, noise=SILENT)
    pairs = list(zip(case.recording.trajectories, clean.trajectories, strict=True))
    squares = np.array([np.mean((a.torque - b.torque) ** 2) for a, b in pairs])
    assert squares.mean() == pytest.approx(SIGMA**2, abs=4.0 * squares.std(ddof=1) / np.sqrt(len(squares)))
    white = np.array([a.qd - b.qd for a, b in pairs])
    assert white.std() == pytest.approx(noise.velocity, rel=4.0 / np.sqrt(2.0 * white.size))
    counts = pairs[0][0].q / noise.encoder
    assert np.abs(counts - np.round(counts)).max() < 4.0 * ROUNDING * np.abs(counts).max()


def test_two_effects_and_a_background() -> None:
    """Pairs and backgrounds hold both effects; together they leave more than one alone."""
    pair = make_case(PAIRS[5], level=0.8, seed=1, size="small")
    assert pair.truth.kinds == PAIRS[5] and pair.truth.background == () and pair.level > 0.8 * (1.0 + TOLERANCE)
    behind = make_case("stribeck", level=0.4, seed=1, size="small", background="creep")
    assert behind.truth.kinds == ("stribeck",) and behind.truth.background == ("creep",)
    assert behind.truth.depends_on == {"memory"} and behind.level > 0.4 * (1.0 + TOLERANCE)


def test_edges_fall_between_samples() -> None:
    """The current is held between updates that do not coincide with samples, within 0 to 1.5 A."""
    session = make_session(seed=np.random.SeedSequence([6, 0]))
    assert session.kind.count("sine") == 16 and len(session.kind) == 32
    edges = session.command.edge[:, 1:]
    phase = (edges[np.isfinite(edges)] * 200.0) % 1.0
    assert 0.4 < phase.mean() < 0.6 and 0.2 < phase.std() < 0.4
    current = session.command.at(session.t)
    assert current.min() >= 0.0 and 1.3 < current.max() <= 1.5
    assert np.all(session.qd[:, 0] == 0.0) and 4.0 < np.abs(session.qd).max() <= 8.0


def test_a_shaft_that_leaves_its_stop_moves_by_its_balance() -> None:
    """Pulled off a loaded device within a wide gap, the shaft obeys K*z/(1 + alpha*|v|) + B*v = 0 of a finer solver.

    A stepped decay is at most one step early or late.
    """
    base, dt, rest = Device.drawn(0.0, np.random.SeedSequence(0)).base, 1e-4, 1.0
    k, b, alpha = base["K0"] + base["K1"], base["B"], base["alpha"]
    t = np.arange(2000) * dt
    drive = np.where(t < 0.1, 10.0 * t, rest - 50.0 * (t - 0.1))[None]
    found = behind_gap(drive, 0.8, np.full_like(drive, k), base, dt)
    left = 1000 + int(np.argmax(found.contact[0, 1000:] == 0.0))
    open_ = slice(left, left + 200)
    assert not found.contact[0, open_].any()

    def rate(_: float, z: np.ndarray) -> np.ndarray:
        v = 2.0 * k * z / (b + np.sqrt(b * b + 4.0 * alpha * b * k * z))
        return -v * (1.0 + (base["beta"] - base["gamma"]) * z)

    exact = solve_ivp(rate, (0.0, 0.02), found.z[0, left : left + 1], t_eval=np.arange(200) * dt, rtol=1e-9).y[0]
    miss = np.abs(found.z[0, open_] - exact).max() / exact[0]
    print(f"z {exact[0]:.3f} to {exact[-1]:.3f} rad, largest miss {miss:.4f} of it")
    assert exact[-1] < 0.7 * exact[0] and miss < dt * abs(rate(0.0, exact[0])) / exact[0]


def test_strengths_are_hidden_together_and_a_triangle_turns_round_at_once() -> None:
    """Each within a factor of 1.25 of its typical size; from one full speed to the other within four samples."""
    sizes = {"backlash": 1e-3, "rotor_inertia": 2e-3}
    plan = Plan(family="single", size="small", seed=3, motion="triangles", strengths=tuple(sizes.items()))
    case, other = plan.make(0), plan.make(1)
    assert isinstance(case, Case) and case.truth.kinds == tuple(sizes) == other.truth.kinds
    for name, typical in sizes.items():
        stated, again = (x.truth.parameters[name] for x in (case, other))
        assert typical / 1.25 <= stated["value"] <= 1.25 * typical and stated["value"] != again["value"]
        assert stated["level"] is None
    qd, separate = case.motion.qd / np.abs(case.motion.qd).max(axis=1, keepdims=True), 4 * case.motion.substeps
    assert ((qd[:, :-separate] > 0.9) & (qd[:, separate:] < -0.9)).any(axis=1).all()
    for family, kinds in (("none", ()), ("single", ("backlash",))):
        with pytest.raises(ValueError, match="strengths are of family 'single'"):
            Plan(family=family, kinds=kinds, strengths=(("backlash", 1e-3),))


@pytest.mark.parametrize(
    ("family", "asked"),
    [("foreign", {"motion": "triangles"}), ("outside", {"noise": "harsh"}), ("bench", {"joined": True})]
    + [("mechanics", asked) for asked in ({"size": "small"}, {"base_spread": 0.0}, {"truth_rate": 1e4})],
)
def test_a_family_refuses_what_it_has_of_its_own(family: str, asked: dict[str, Any]) -> None:
    """A setting that would change nothing is named; what the family reads it takes."""
    with pytest.raises(ValueError, match=f"family '{family}' has its own {min(asked)}; leave out"):
        Plan(family=family, **asked)
    if family != "mechanics":
        assert Plan(family=family, size="small").arguments(0)["size"] == "small"


def test_files_hold_the_recording(tmp_path: Path) -> None:
    """A linear damper with a voltage and no velocity at 1 kHz: the loader reads back what the case holds."""
    case = make_case(
        "coulomb_friction", level=0.4, seed=11, size="small", rate=1000.0, linear=True, voltage=True, velocity=False
    )
    assert case.truth.parameters["coulomb_friction"]["unit"] == "N"
    write_case(case, tmp_path)
    read = load_recording(tmp_path)
    assert read.units == {"q": "m", "current": "V", "torque": "N"} and (tmp_path / "truth.json").is_file()
    for a, b in zip(read.trajectories, case.recording.trajectories, strict=True):
        assert a.id == b.id and a.qd_derived and b.qd_derived and a.dt == pytest.approx(1e-3, rel=1e-6)
        for channel in ("t", "q", "current", "torque"):
            np.testing.assert_array_equal(getattr(a, channel), getattr(b, channel))
        rounded = 100.0 * ROUNDING * np.abs(b.q).max() / b.dt  # a slope by sums over 21 samples
        np.testing.assert_allclose(a.qd, b.qd, rtol=0.0, atol=rounded)
    with pytest.raises(ValueError, match="without velocity"):
        make_case("velocity_lag", level=0.4, seed=0, velocity=False)


# --- the suite, with a stub in place of the diagnosis ---


def _result(verdict: str | None, *causes: tuple[str, tuple[str, ...]], depends_on: tuple[str, ...] = ()) -> Any:
    """A result as the diagnosis returns it."""
    parameter = SimpleNamespace(value=0.0043, ci95=(0.0, 1.0), unit="s")
    return SimpleNamespace(
        verdict=verdict,
        causes=[
            SimpleNamespace(name=name, parameters={"time_constant": parameter}, p_value=1e-4, alternatives=list(others))
            for name, others in causes
        ],
        parameter_shift=[],
        unexplained=SimpleNamespace(depends_on=list(depends_on), share=0.5) if depends_on else None,
        gain=SimpleNamespace(rmse_reduction=0.07, ci95=(0.05, 0.09), held_out=[]),
        law=None,
        suspects=[],
        recording_faults=(),
        account=None,
        seconds=0.0,
    )


def blames_the_coil(recording: Recording, *, seed: int) -> Any:
    """A diagnosis that knows one cause."""
    assert len(recording.trajectories) == 12 and seed >= 0
    return _result("named", ("coil_lag", ()))


@pytest.mark.parametrize(
    ("kinds", "background", "result", "outcome"),
    [
        (("coil_lag",), (), _result("named", ("coil_lag", ())), "right"),
        (("coil_lag",), (), _result("named", ("command_delay", ("coil_lag",))), "ambiguous"),
        (("coil_lag",), (), _result("named", ("command_delay", ())), "wrong"),
        (("coil_lag",), (), _result("named", ("coil_lag", ()), ("cogging", ())), "wrong"),
        (("coil_lag",), (), _result("none"), "missed"),
        (("coil_lag",), (), _result(None), "missed"),
        (("coil_lag",), (), _result("unexplained", depends_on=("current",)), "missed"),
        (("coil_lag",), (), _result("named_and_unexplained", ("coil_lag", ()), depends_on=("q",)), "other"),
        (("coil_lag", "cogging"), (), _result("named", ("cogging", ()), ("coil_lag", ())), "right"),
        (("coil_lag", "cogging"), (), _result("named", ("cogging", ())), "missed"),
        (("coil_lag", "cogging"), (), _result("named", ("cogging", ()), ("stribeck", ())), "wrong"),
        (("wear",), ("creep",), _result("named_and_unexplained", ("wear", ()), depends_on=("memory",)), "right"),
        (("wear",), ("creep",), _result("named", ("wear", ())), "other"),
        ((), ("creep",), _result("unexplained", depends_on=("current", "memory")), "right"),
        ((), ("creep",), _result("unexplained", depends_on=("current", "q", "memory")), "other"),
        ((), ("creep",), _result("named", ("coil_lag", ())), "wrong"),
        ((), (), _result("none"), "right"),
        ((), (), _result("unexplained", depends_on=("q",)), "wrong"),
    ],
)
def test_outcomes(kinds: tuple[str, ...], background: tuple[str, ...], result: Any, outcome: str) -> None:
    """Each pair of truth and result has the outcome that is counted."""
    depends_on = frozenset().union(*(EFFECTS[name].depends_on for name in background))
    truth = Truth(kinds=kinds, background=background, parameters={}, depends_on=depends_on, base={})
    assert judge(truth, False, record_of(result))[0] == outcome


def test_exact_rivals_of_a_calibration_shift_are_ambiguous() -> None:
    """Bias and offset cannot be distinguished: naming one with the other as its rival counts as ambiguous."""
    truth = Truth(kinds=("torque_bias",), background=(), parameters={}, depends_on=frozenset(), base={})
    result = _result("none")
    result.parameter_shift = [
        SimpleNamespace(name="encoder_offset", value=0.1, ci95=(0.0, 0.2), alternatives=["torque_bias"])
    ]
    assert judge(truth, True, record_of(result))[0] == "ambiguous"
    none = Truth(kinds=(), background=(), parameters={}, depends_on=frozenset(), base={})
    assert judge(none, False, record_of(result))[0] == "other"


def test_suite_resumes_and_prints(tmp_path: Path) -> None:
    """A suite stopped half way goes on where it stopped, with the same cases; its tables hold every case."""
    plan = Plan(family="single", size="small", kinds=("coil_lag", "cogging"), seed=3)
    lines: list[str] = []
    run_suite(plan, 2, tmp_path, jobs=0, diagnose=blames_the_coil, report=lines.append)
    with (tmp_path / "cases.jsonl").open("a") as stream:
        stream.write('{"index": 2, "cut o')  # a process that was killed while it wrote
    cases = run_suite(plan, 4, tmp_path, jobs=0, diagnose=blames_the_coil, report=lines.append)
    assert len(lines) == 4 and [case["index"] for case in cases] == [0, 1, 2, 3]
    assert [case["outcome"] for case in cases] == ["right", "wrong", "right", "wrong"]
    assert cases[0]["seed"] == 3 * 100_003 and cases[0]["coverage"][0]["covered"]
    again = run_suite(plan, 4, tmp_path, jobs=0, diagnose=blames_the_coil, report=lines.append)
    assert len(lines) == 4 and again == json.loads(json.dumps(cases))
    text = report(cases)
    assert "2/4" in text and "coil_lag" in text and "median" in text
    with pytest.raises(SuiteError, match="another suite"):
        run_suite(dataclasses.replace(plan, level=0.8), 4, tmp_path, jobs=0, diagnose=blames_the_coil)


def test_known_effects_alone_may_be_named(tmp_path: Path) -> None:
    """With --known the diagnosis gets the hidden effects' names; its cases are another suite's."""
    asked: list[Any] = []

    def informed(recording: Recording, **options: Any) -> Any:
        asked.append(options.get("effects"))
        return blames_the_coil(recording, seed=options["seed"])

    plan = Plan(family="single", size="small", kinds=("coil_lag", "cogging"), seed=3)
    for index in range(2):
        run_case(plan, index, known=True, diagnose=informed)
    run_case(plan, 0, diagnose=informed)
    assert asked == [("coil_lag",), ("cogging",), None]
    run_suite(plan, 1, tmp_path, jobs=0, known=True, diagnose=informed, report=lambda line: None)
    with pytest.raises(SuiteError, match="another suite"):
        run_suite(plan, 1, tmp_path, jobs=0, diagnose=informed)


def test_failures_are_outcomes() -> None:
    """A diagnosis that raises does not end the suite."""

    def breaks(recording: Recording, *, seed: int) -> Any:
        raise ZeroDivisionError("by seed")

    case = run_case(Plan(family="none", size="small"), 0, diagnose=breaks)
    assert case["outcome"] == "failed" and "ZeroDivisionError" in case["remark"]


@pytest.mark.parametrize("family", FAMILIES)
def test_every_family_has_its_cases(family: str) -> None:
    """Every case of a family can be asked for; families rotate through effects, noises, sizes and renderings."""
    plan = Plan(family=family)
    arguments = [plan.arguments(index) for index in range(200)]
    assert len({a["seed"] for a in arguments}) == 200
    assert all(a.get("velocity", True) for a in arguments if a["kind"] == "velocity_lag")
    expected = {"none": 1, "uncatalogued": 6, "pairs": 6, "calibration": 4, "bench": len(bench.EFFECTS)}
    expected |= {name: len(set(laws.HIDDEN)) for name, laws in OTHER_LAWS.items()}
    assert len({a["kind"] for a in arguments}) == expected.get(family, len(SINGLE))
    if family == "none":
        assert len({(a["noise"], a["size"], a["base_spread"]) for a in arguments}) == 12
    if family == "background":
        assert len({(a["kind"], a["background"]) for a in arguments}) > 40
    with pytest.raises(ValueError, match="not in family"):
        Plan(family=family, kinds=("nothing",))
