"""Why a model explains next to nothing of a torque: what the torque follows instead, as far as plain means show it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING

import numpy as np

from mrwarp.recording.data import quantity, with_unit
from mrwarp.sysid.settings import Gain

if TYPE_CHECKING:
    from mrwarp.identify.dataset import Dataset

_HARDLY = 100.0
"""Range of the angle, in standard deviations of its noise, below which a joint hardly moves."""
_PER_BIN, _BINS = 20, (20, 720)
"""Samples for each bin over the angle, and fewest and most bins: a cogging of 72 per turn has ten bins a period."""
_BLOCKS = 10
"""Blocks of a run that take turns in predicting each other: a place comes again in both, if it does at all."""
_SOFT = 0.05
"""Share of the usual speed over which dry friction turns its direction."""


def missed(error: np.ndarray, torque: np.ndarray, counts: np.ndarray, share: float = Gain.share) -> float:
    """NRMSE by which a model is kept or refused, wherever one is written: single spikes do not count.

    Args:
        error: Simulated minus measured torque, shape (N,).
        torque: The measured one, shape (N,).
        counts: Weight of each sample, shape (N,): 0 where it takes no part.
        share: Samples that do not count, those with the largest errors [1].
    """
    seen = np.broadcast_to(counts, error.shape) > 0.0
    size = np.abs(error[seen])
    plain = size <= np.quantile(size, 1.0 - share)
    return float(np.sqrt(np.mean(size[plain] ** 2))) / (float(torque[seen][plain].std()) or 1.0)


def explains_nothing(
    nrmse: float, data: Dataset, units: Mapping[str, str], gain: Gain | None = None, *, every_effect: bool = False
) -> str:
    """Advice where even the best model misses most of the torque.

    Args:
        nrmse: Its error over the torque's standard deviation.
        data: The samples.
        units: Units of the recording.
        gain: What is a clear share; None: the defaults.
        every_effect: Whether the model was the best with every effect of the catalogue, not eqs. 14 and 15 alone.
    """
    what = "eqs. 14 and 15 and every effect of the catalogue explain" if every_effect else "eqs. 14 and 15 explain"
    name = quantity("torque", units)
    reason = followed_instead(data, units, gain, every_effect=every_effect) or (
        "check that it was measured at this joint, that the columns belong together, and that the bench prescribed the "
        "motion. In a log of a walking robot the motion answers to the torque"
    )
    return f"{what} next to nothing of the {name} (NRMSE {100.0 * nrmse:.1f} %): {reason}"


def followed_instead(
    data: Dataset,
    units: Mapping[str, str],
    gain: Gain | None = None,
    *,
    every_effect: bool = False,
    left: np.ndarray | None = None,
) -> str:
    """Cause of a torque that eqs. 14 and 15 miss, with a remedy; empty where nothing shows it.

    ``left`` is what a model leaves of it, shape (N,); None: what the plainest laws do.
    """
    gain = gain or Gain()
    angle, torque = quantity("q", units), quantity("torque", units)
    if hardly := hardly_moves([data.q[part] * data.scales.q for part in data.parts], units):
        return hardly
    if own := own_noise([data.torque[part] * data.scales.torque for part in data.parts], units, gain):
        return (
            f"the {torque} hardly rises above its own noise ({own} from sample to sample): move the joint further, "
            f"raise the {quantity('current', units)}, or use a sensor of a smaller range, and try again"
        )
    named = "" if every_effect else "; eq. 14 has no such term: mrwarp diagnose looks for it, and writes the model"
    plain = _plain_laws(data)
    rest = _rest(plain, data.torque) if left is None else left - left.mean()
    qdd = np.concatenate([np.gradient(data.qd[part], dt) for part, dt in zip(data.parts, data.dt, strict=True)])
    moved = _rest(plain, qdd)
    by_inertia = 0.0
    if not any(_opposed(plain[part], data.torque[part], qdd[part], gain.part) for part in data.parts):
        by_inertia = _followed(rest, _rest(moved[:, None], rest))
    turn = 2.0 * np.pi / data.scales.q if units["q"] == "rad" else np.inf
    in_all, in_each = (
        _followed(rest, rest - by_place(data.q, rest, data.parts, turn, own=own)) for own in (False, True)
    )
    if by_inertia > max(gain.half, in_all):
        share = 100.0 * by_inertia
        return f"{share:.0f} % of what is left goes with the acceleration, as an inertia's {torque} does{named}"
    if in_all > gain.half:
        return (
            f"{100.0 * in_all:.0f} % of what is left comes again at the same {angle} in all runs, as cogging or a "
            f"weight's {torque} does{named}"
        )
    if in_each > gain.half:
        cogs = float(np.ptp(data.q)) > turn
        load = "cogging that" if cogs else "a load that depends on the place, such as a weight or a spring, and"
        differs = f"differs between runs{f', or an {angle} that begins elsewhere in each' if cogs else ''}"
        return (
            f"{100.0 * in_each:.0f} % of what is left comes again at the same {angle} within each run, but "
            f"{100.0 * max(in_all, 0.0):.0f} % from run to run. It looks like {load} {differs}; keep it the same, or "
            f"take it out of the {torque}, and try again"
        )
    return ""


def _opposed(plain: np.ndarray, torque: np.ndarray, qdd: np.ndarray, part: float) -> bool:
    """Whether the torque of a run falls where the acceleration rises, all else being equal, as no inertia's does.

    Where a drive holds a speed, cogging makes both its torque and the acceleration, and neither is the other's cause.
    """
    left, moved = _rest(plain, torque), _rest(plain, qdd)
    return float(left @ moved) < -part * float(np.sqrt((left @ left) * (moved @ moved)))


def hardly_moves(angles: Sequence[np.ndarray], units: Mapping[str, str]) -> str:
    """Advice on a joint whose angle covers little more than its noise in each run; else nothing."""
    reach, noise = (float(np.median([measure(q) for q in angles])) for measure in (np.ptp, _white))
    if reach >= _HARDLY * noise:
        return ""
    covered = with_unit(f"{reach:.2g}", units["q"])
    return (
        f"the joint hardly moves (the {quantity('q', units)} covers {covered}, {reach / noise:.0f} times its noise); "
        "move it by at least ten times what it takes to make it yield, and try again"
    )


def own_noise(torques: Sequence[np.ndarray], units: Mapping[str, str], gain: Gain) -> str:
    """Noise of a torque, of each run, that is hardly more than noise; nothing if it is more."""
    rough = float(np.mean([_white(torque) ** 2 for torque in torques]))
    noisy = rough > gain.half * float(np.concatenate(torques).var())
    return with_unit(f"{np.sqrt(rough):.2g}", units["torque"]) if noisy else ""


def _white(x: np.ndarray) -> float:
    """Standard deviation of white noise by second differences."""
    return float(np.diff(x, 2).std()) / np.sqrt(6.0) if len(x) > 2 else 0.0


def _followed(whole: np.ndarray, left: np.ndarray) -> float:
    """Share of the variance that is gone."""
    return 1.0 - float(left.var()) / max(float(whole.var()), 1e-300)


def _plain_laws(data: Dataset) -> np.ndarray:
    """Columns of the plainest laws of a passive joint, shape (N, C)."""
    rubs = np.tanh(data.qd / (_SOFT * (float(np.percentile(np.abs(data.qd), 95)) or 1.0)))
    columns = [np.ones_like(rubs), data.qd, rubs, data.q, data.current, data.current * rubs, data.current * data.qd]
    return np.column_stack(columns)


def _rest(table: np.ndarray, x: np.ndarray) -> np.ndarray:
    """Rest of a quantity after columns, shape (N,)."""
    table = table / np.maximum(np.abs(table).max(axis=0), 1e-300)
    return x - table @ np.linalg.lstsq(table, x, rcond=1e-9)[0]


def by_place(angle: np.ndarray, rest: np.ndarray, runs: Sequence[slice], turn: float, *, own: bool) -> np.ndarray:
    """Mean of a torque, or of a rest of it, at the same place, shape (N,).

    Args:
        angle: Angle or displacement, shape (N,).
        rest: The torque, shape (N,).
        runs: The samples of each run.
        turn: A turn in the unit of the angle; infinite for a displacement.
        own: Whether the mean is taken in other blocks of the same run, instead of in the other half of the runs.
    """
    out = np.zeros_like(rest)
    groups = [[run] for run in runs] if own or len(runs) < 2 else [runs]
    for group in groups:
        at = np.concatenate([np.arange(run.start, run.stop) for run in group])
        if len(group) > 1:
            half = np.concatenate([np.full(run.stop - run.start, k % 2) for k, run in enumerate(group)])
        else:
            half = np.arange(len(at)) * _BLOCKS // len(at) % 2
        q = angle[at]
        place = q % turn if np.ptp(q) > turn else q - q.min()
        bins = int(np.clip(len(at) // _PER_BIN, *_BINS))
        index = np.minimum((place / max(float(place.max()), 1e-300) * bins).astype(int), bins - 1)
        for k in (0, 1):
            others, mine = half != k, half == k
            counts = np.bincount(index[others], minlength=bins)
            means = np.bincount(index[others], rest[at][others], minlength=bins) / np.maximum(counts, 1)
            out[at[mine]] = means[index[mine]]
    return out
