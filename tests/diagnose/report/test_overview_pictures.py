"""Pictures of a diagnosis: there for every verdict, of the right size, and the profiles shows what is hidden."""

import dataclasses
import io

import matplotlib.image
import numpy as np
import pytest
from matplotlib.collections import LineCollection

from mrwarp.diagnose.report import mismatch_profile as profiles
from mrwarp.diagnose.report import overview_pictures as pictures
from mrwarp.diagnose.report import trace_pictures as traces
from mrwarp.diagnose.result import Diagnosis
from mrwarp.diagnose.verdict_text import digits, quantity, readable
from mrwarp.sysid.verdict import Value
from tests.diagnose import made_up

UNITS = {"q": "rad", "current": "A", "torque": "N·m"}


def test_every_picture_is_drawn() -> None:
    """All nine, none empty, none larger than a phone loads."""
    found, notes = pictures.draw(made_up.make("named_and_unexplained"))
    assert not notes and tuple(found) == pictures.NAMES
    for name, data in found.items():
        image = matplotlib.image.imread(io.BytesIO(data))
        assert 400 <= image.shape[1] <= 900, name
        assert image[..., :3].std() > 0.02, name  # something is drawn
        assert len(data) < 400_000, name


def test_without_a_verdict_only_the_data_are_shown() -> None:
    """Nothing that looks like a verdict."""
    assert tuple(pictures.draw(made_up.make(None))[0]) == ("data",)


def made(d: Diagnosis) -> None:
    """Make all figures but no files, whose layout takes most of the time."""
    for maker in (pictures.data_picture, pictures.gain_picture, pictures.tried_picture, *pictures.MAKERS.values()):
        figure = maker(d)
        assert figure is not None and figure.axes


def strangely_named(runs: int) -> Diagnosis:
    """A diagnosis whose trajectories' names hold dollars, line breaks and braces."""
    d = made_up.make("named", runs=runs, samples=400)
    own = tuple(dataclasses.replace(r, id=f"$\\frac{{{k}}}\n<b>") for k, r in enumerate(d.recording.trajectories))
    per = dict(zip((r.id for r in own), d.per_trajectory.values(), strict=True))
    recording = dataclasses.replace(d.recording, trajectories=own)
    return dataclasses.replace(d, recording=recording, per_trajectory=per, gain=None)


def test_few_and_many_trajectories_whose_names_are_no_formulas() -> None:
    """One, and more than can be written by name; their names are drawn as they are."""
    made(strangely_named(1))
    made(strangely_named(40))


@pytest.mark.parametrize("slower", [[1, 3, 5, 7], [0, 1, 2]])
def test_runs_of_two_rates_are_drawn(slower: list[int]) -> None:
    """Half of the runs at half of the rate, or fewer: the spectrum is of the commonest rate."""
    d = made_up.make("named")
    runs = [
        dataclasses.replace(r, t=(2.0 if k in slower else 1.0) * r.t) for k, r in enumerate(d.recording.trajectories)
    ]
    made(dataclasses.replace(d, recording=dataclasses.replace(d.recording, trajectories=runs)))


def test_one_that_fails_costs_a_note(monkeypatch: pytest.MonkeyPatch) -> None:
    """The others are drawn; the note names it and the reason; a full disk is an error."""

    def fails(d):
        raise ValueError("cannot convert float NaN to integer")

    monkeypatch.setattr(pictures, "MAKERS", {"spectrum": fails, "worst": fails})
    found, notes = pictures.draw(made_up.make("named"))
    note = notes[0]
    assert set(found) == {"accounting", "gain", "tried", "data"} and len(notes) == 2
    assert "'spectrum'" in note and "cannot convert float NaN" in note

    def full(d):
        raise OSError(28, "No space left on device")

    monkeypatch.setitem(pictures.MAKERS, "spectrum", full)
    with pytest.raises(OSError, match="No space"):
        pictures.draw(made_up.make("named"))


def test_other_units_are_on_the_axes() -> None:
    """A linear damper driven by a voltage has displacement, force and driver voltage."""
    labels = [a.label for a in profiles.axes_of("current", made_up.make().traces, UNITS | {"current": "V"})]
    assert labels == ["driver voltage [V]"]
    assert quantity("torque", {"torque": "N"}) == "force"


def test_a_lag_shows_after_the_steps_of_the_current() -> None:
    """Of all views for 'current' and 'memory', the time since the last step explains the hidden lag best."""
    t = made_up.make("named").traces
    axes = [axis for name in ("current", "memory") for axis in profiles.axes_of(name, t, UNITS)]
    found = profiles.best_profile(axes, t)
    assert found is not None
    assert found.axis.label == "time since the last step of the current [s]"
    assert found.share > 0.3
    assert found.left < 0.02 * found.share
    # one sample after the step exp(-5 ms/10 ms) of it is missing, four samples on exp(-2)
    ratio = np.interp(0.020, found.x, found.before) / np.interp(0.005, found.x, found.before)
    assert ratio == pytest.approx(np.exp(-1.5), rel=0.15)


@pytest.mark.parametrize("name", ["q", "qd", "qdd", "current", "time"])
def test_noise_stays_in_its_band(name: str) -> None:
    """Without structure about 95 % of the bin means lie in the 95 % band."""
    inside = []
    for seed in range(6):
        t = made_up.make("none").traces
        assert t is not None
        noise = made_up.NOISE * np.random.default_rng(seed).normal(size=len(t.torque))
        t = dataclasses.replace(t, torque=t.baseline + noise)
        [axis] = profiles.axes_of(name, t, UNITS)
        found = profiles.profile(dataclasses.replace(axis, signs={"": axis.signs[""]}), t)
        assert found is not None
        inside += list(abs(found.after) <= found.band)
    assert 0.86 <= np.mean(inside) <= 1.0


def test_a_variable_that_does_not_vary_has_no_profile() -> None:
    """A constant current is no axis."""
    t = made_up.make("none").traces
    assert t is not None
    t = dataclasses.replace(t, current=np.ones_like(t.current))
    [axis] = profiles.axes_of("current", t, UNITS)
    assert profiles.profile(axis, t) is None
    assert "current" not in {a.label for a in profiles.axes_of("memory", t, UNITS)}


def test_each_of_several_causes_is_shown_by_what_it_takes_away() -> None:
    """Under a cause's title stands the mismatch without it alone, and cogging is drawn within one of its periods."""
    d = made_up.make("named")
    t = d.traces
    assert t is not None
    wave = 0.2 * np.sin(60.0 * t.q)
    cogging = dataclasses.replace(
        d.causes[0],
        name="cogging",
        alternatives=(),
        parameters={"periods": Value(value=60.0, ci95=(59, 61), unit="1/rad")},
    )
    t = dataclasses.replace(
        t,
        torque=t.torque + wave,
        extended=t.extended + wave,
        without={"coil_lag": t.baseline + wave, "cogging": t.extended},
    )
    figure = traces.evidence_picture(dataclasses.replace(d, causes=(*d.causes, cogging), traces=t))
    assert figure is not None
    lag, teeth = figure.axes[:2]
    assert "Coil lag" in lag.get_title() and "time since the last step" in lag.get_xlabel()
    assert "ogging" in teeth.get_title() and "one period of 0.105" in teeth.get_xlabel()
    before, after = (np.asarray(line.get_ydata()) for line in teeth.get_lines()[1:3])
    assert np.ptp(before) == pytest.approx(0.4, rel=0.1) and np.ptp(after) < 0.05


def test_cogging_that_nobody_named_is_shown_within_its_period() -> None:
    """Forty turns to a run of bins alias: 25 bins over the angle show a tenth of it, those of a period nearly all."""
    t = made_up.make("none").traces
    assert t is not None
    assert len(profiles.axes_of("q", t, UNITS)) == 1  # noise repeats nowhere
    t = dataclasses.replace(t, torque=t.torque + 0.2 * np.sin(313.0 * t.q))
    plain, fine = profiles.axes_of("q", t, UNITS)
    assert f"one period of {2.0 * np.pi / 313.0:.3g}" in fine.label
    shares = [0.0 if (p := profiles.profile(axis, t)) is None else p.share for axis in (plain, fine)]
    assert shares[0] < 0.1 and shares[1] > 0.7


def test_numbers_have_four_digits_at_most() -> None:
    """However narrow their interval; a compliance has its spring constant next to it."""
    for value, half, shown in ((12.047, 0.001, "12.05"), (123456.0, 0.1, "123500"), (0.0098123, 1e-6, "0.009812")):
        assert digits(value, half) == shown
    assert readable(Value(value=0.004, ci95=(0.003, 0.005), unit="rad/(N·m)")).value == "0.0040 rad/(N·m) (250 N·m/rad)"


def test_one_panel_shows_two_statements_with_identical_curves() -> None:
    """The titles are joined; another curve has a panel of its own."""
    t = made_up.make("named").traces
    lag, angle = (profiles.profile(profiles.axes_of(name, t, UNITS)[0], t) for name in ("memory", "q"))
    panels = list(traces._merged([(lag, "coil lag"), (angle, "cogging"), (lag, "delay")]))
    assert [text for _, text in panels] == ["coil lag and delay", "cogging"]


def test_intervals_of_tried_effects_stay_within_all_of_the_mismatch() -> None:
    """Nothing takes away more than all or less than nothing, however wide the interval."""
    d = made_up.make("named")
    wide = tuple(dataclasses.replace(t, gain=0.9, error=0.4) for t in d.tried)
    figure = pictures.tried_picture(dataclasses.replace(d, tried=wide))
    assert figure is not None
    axis = figure.axes[0]
    ends = np.concatenate([np.concatenate(c.get_segments()) for c in axis.collections if isinstance(c, LineCollection)])
    assert 0.0 <= ends[:, 0].min() and ends[:, 0].max() <= 100.0 + 1e-9 <= axis.get_xlim()[1]
