"""Lines while a diagnosis works: every step, and the time that is left in between."""

import time

from mrwarp.diagnose.report.countdown import Countdown


def test_a_long_step_is_not_mute() -> None:
    """A line at least as often as asked, with the time that is left once a step has shown how quick things go."""
    said: list[tuple[float, str]] = []
    with Countdown(lambda text: said.append((time.perf_counter(), text)), every=0.3) as log:
        log("eqs. 14 and 15: starts")
        log("noise")
        time.sleep(0.6)
        log("15 effects as candidates")
        time.sleep(1.2)
        log("the joint rests now and then")
    times, texts = zip(*said, strict=True)
    assert max(b - a for a, b in zip(times, times[1:], strict=False)) < 0.9
    assert texts[0] == "eqs. 14 and 15: starts" and texts[-1] == "the joint rests now and then"
    assert any(text.startswith("15 effects as candidates: going on, about ") for text in texts)


def test_time_left_shrinks_within_a_step() -> None:
    """It follows from what the steps before took; a step that lasts much longer may last longer still."""
    log = Countdown(lambda text: None)
    assert log.left(log._begun) is None
    log("pairs: coil_lag with cogging")
    log._begun -= 48.0  # the steps before took 48 s of about 100
    begin = log._step_begun
    first, later, late = (log.left(begin + seconds) or 0.0 for seconds in (0.0, 10.0, 500.0))
    assert 45.0 < first < 60.0 and later == first - 10.0 and 50.0 < late < 150.0
