"""Progress of commands: stages in six words, estimates that do not jump, one line per stage without a terminal."""

import io
import re
import subprocess
import sys
import time
from typing import Any

import pytest

from mrwarp.diagnose.report.countdown import Countdown
from mrwarp.options.progress_bar import STAGE_WORDS, ProgressBar, stage_of
from mrwarp.rl import progress as training
from mrwarp.robot_logs.report import stages


class Terminal(io.StringIO):
    """A stream that is a terminal."""

    def isatty(self) -> bool:
        """Always."""
        return True


def pretended(bar: ProgressBar, seconds: float) -> None:
    """Let time pass for a bar."""
    bar._begun -= seconds


@pytest.mark.parametrize(
    ("text", "stage"),
    [
        ("other hysteresis laws: Kwok's law, Guo's arctangent law", "other hysteresis laws"),
        ("replaying 38 windows: 15 of 45 robots", "replaying 38 windows"),
        ("one two three four five six seven", "one two three four five six"),
        ("table6: walks", "table6"),
        ("fig4:", "fig4"),
        ("pictures", "pictures"),
    ],
)
def test_a_stage_is_its_first_clause(text: str, stage: str) -> None:
    """Of at most six words."""
    assert stage_of(text) == stage and len(stage.split()) <= STAGE_WORDS


def test_without_a_terminal_a_stage_is_one_line() -> None:
    """However often it is reported, and with whichever numbers; a note stands whole, once."""
    stream = io.StringIO()
    bar = ProgressBar(stream)
    for k in range(40):
        bar(f"replaying {k} windows: {k} of 40 robots", k / 40.0)
        bar("warning: no break-away test: the holding torque is assumed equal to the slow sliding torque")
    bar("pictures", 0.95)
    bar.done()
    lines = stream.getvalue().splitlines()
    assert [re.sub(r"^\[ *[\d.]+ s\] ", "", line).partition(",")[0] for line in lines] == [
        "replaying 0 windows",
        "warning: no break-away test: the holding torque is assumed equal to the slow sliding torque",
        "pictures",
    ]
    assert "\r" not in stream.getvalue()


def test_a_terminal_has_one_line_that_is_drawn_again() -> None:
    """With the share as a bar; notes above it; nothing is left of it."""
    stream = Terminal()
    with ProgressBar(stream) as bar:
        bar("learning to walk", 0.5, detail="reward 3.21", ending="typically 2 min to the gate")
        bar.line("walking gate: not yet")
    text = stream.getvalue()
    assert f"[{'#' * 10}{'-' * 10}]  50%  learning to walk, reward 3.21, typically 2 min to the gate" in text
    assert text.count("\n") == 1 and "\r\033[Kwalking gate: not yet\n" in text and text.endswith("\r\033[K")


def test_an_estimate_is_shown_only_where_it_is_steady() -> None:
    """Not from the first percent, nor after a jump; it shrinks with time, and ends where the work lasts longer."""
    bar = ProgressBar(io.StringIO())
    bar("a", 0.01)
    pretended(bar, 36.0)
    bar("a", 0.02)
    assert bar.left(time.perf_counter()) is None  # 1800 s, of what takes 60
    pretended(bar, 4.0)
    bar("b", 0.6)
    assert bar.left(time.perf_counter()) is None  # 67 s: too far from the estimate before
    pretended(bar, 4.0)
    bar("b", 0.66)
    now = time.perf_counter()
    assert bar.left(now) == pytest.approx(44.0 / 0.66 - 44.0, abs=0.5)
    assert bar.left(now + 10.0) == pytest.approx((bar.left(now) or 0.0) - 10.0)
    assert bar.left(now + 1000.0) is None


def test_stages_of_a_diagnosis_do_not_turn_the_bar_back() -> None:
    """A stage that comes again, as after a rejection, keeps the share."""
    seen: list[float] = []

    class Bar(ProgressBar):
        def __call__(self, text: str, share: float | None = None, **more: Any) -> None:
            seen.append(share or 0.0)

    count = Countdown(Bar(io.StringIO()))
    for text in ("eqs. 14 and 15: starts", "noise", "refining coil_lag", "noise without coil_lag", "what repeats"):
        count(text)
    assert seen == [0.01, 0.02, 0.19, 0.19, 0.85]


def test_a_log_is_diagnosed_in_stages() -> None:
    """A terminal shows which of how many, and what is done in it; without one each has its line."""
    texts = (
        "reading: go2.usda",
        "fit: round 1 of 4: replay 3",
        "fit: round 2 of 4: replay 1",
        "likely: a coil; checking",
    )
    for stream in (Terminal(), io.StringIO()):
        bar = stages.Countdown(ProgressBar(stream))
        for text in texts:
            bar(text)
        shown, live = stream.getvalue(), stream.isatty()
        assert f"5 of {len(stages.BEGINS)} fit" in shown and "likely: a coil; checking" in shown
        assert ("round 2 of 4" in shown) == live and ("44%" in shown) == live
        assert live or len(shown.splitlines()) == 3
    assert list(stages.BEGINS.values()) == sorted(stages.BEGINS.values())
    assert all(stage_of(f"10 of 10 {stage}").endswith(stage) for stage in stages.BEGINS)


def test_a_training_says_how_long_it_typically_takes() -> None:
    """To the gate by what trainings took, never by the most updates that there may be; without a gate all of them."""
    typical = training.typical_updates(64)
    assert training.ending(100, 0.1, 6000, typical) == "typically 20 s to the gate"
    assert training.ending(900, 0.1, 6000, typical) == "longer than typical"
    assert training.ending(100, 0.1, 800, None) == training.ending(100, 7.0, 110, typical) == "about 70 s left"
    assert training.typical_updates(4096) == pytest.approx(107.0, rel=0.1)


def test_updates_that_compile_are_no_measure() -> None:
    """One of a minute among fifty of a tenth of a second."""
    seen = training.Progress()
    for k in range(training.SETTLED):
        seen.window.append({"collect_ms": 6e4 if k == 0 else 60.0, "learn_ms": 40.0})
    assert seen.update_seconds() == pytest.approx(0.1)


def test_figures_have_at_most_four_digits() -> None:
    """Also at the begin, when every robot falls at once."""
    text = training.figures_line({"reward": 3.21, "v_x_rmse": 0.1234, "falls_per_hour": 36000.0})
    assert text == "reward 3.21, v_x RMSE 0.123 m/s, falls over 9999/h"
    assert max(len(re.sub(r"\D", "", number)) for number in re.findall(r"[\d.]+", text)) <= 4


def test_a_warning_of_a_device_is_printed_once() -> None:
    """From whichever place in the code it comes."""
    code = (
        "import warnings; from mrwarp.runtime import DeviceWarning, quiet_libraries; "
        "quiet_libraries(gpu=False, networks=False)\n"
        "def a(): warnings.warn('too strong', DeviceWarning, stacklevel=1)\n"
        "def b(): warnings.warn('too strong', DeviceWarning, stacklevel=1)\n"
        "a(); b(); b()"
    )
    found = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert found.stderr.splitlines().count("warning: too strong") == 1
