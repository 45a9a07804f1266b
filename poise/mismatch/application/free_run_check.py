"""What of an export makes free runs worse: the changed model against the one before, where no fit saw the recording."""

import math
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from poise.errors import PoiseError
from poise.simulation.rollout import FreeArm, RecordedRun, RolloutOptions, rolled_out

_DRIVES = ("gain", "rate_gain", "delay")
"""Kinds of changes that were fitted together."""
_HELD = 0.3
"""Share at the end of a recording that no fit saw."""
_HORIZONS, _UNSTABLE = (0.1, 1.0, 10.0), (0.1, 1.0)
"""s of free runs; of runs under efforts, in which small errors grow, the shorter ones."""
_SLACK = 0.02
"""Relative growth of an error that is chance."""


@dataclass(frozen=True)
class Worsening:
    """What of a change makes free runs worse.

    Args:
        kinds: of `ModelChanges.kinds`; (): nothing.
        reason: as a clause; "" for nothing.
    """

    kinds: tuple[str, ...] = ()
    reason: str = ""


def worsening(
    run: RecordedRun, source: Path, kinds: Sequence[str], written: Callable[[tuple[str, ...]], bytes], folder: Path
) -> Worsening:
    """The kinds of changes without which a model runs freely no worse than before, chosen one at a time.

    Args:
        run: the recording.
        source: the model before, MJCF.
        kinds: of the changes.
        written: the model without some kinds of changes.
        folder: in which versions are written for a moment, so that they find what they refer to.
    """
    groups: list[tuple[str, ...]] = [(kind,) for kind in kinds if kind not in _DRIVES and not kind.startswith("sensor")]
    drives = tuple(kind for kind in kinds if kind in _DRIVES)
    groups += [drives] if drives else []
    try:
        before = _errors(run, source)
        tried = _ratios(run, written(()), folder, before)
        whole, lost = tried, list[tuple[str, ...]]()
        while _worst(tried) > 1.0 + _SLACK and len(lost) < len(groups):
            left = [group for group in groups if group not in lost]
            found = {group: _without(run, written, folder, before, [*lost, group], len(groups)) for group in left}
            best = min(found, key=lambda group: (_worst(found[group]) > 1.0 + _SLACK, _sum(found[group])))
            tried = found[best]
            lost.append(best)
    except PoiseError:  # such a model does not run, or the recording has nothing that drives it: it is not compared
        return Worsening()
    if not lost:
        return Worsening()
    horizon = max(whole, key=whole.__getitem__)
    times = f"{whole[horizon]:.2f} times as far off with it"
    said = f"free runs of {horizon:g} s where no fit saw the recording are {times}"
    return Worsening(tuple(kind for group in lost for kind in group), said)


def _without(
    run: RecordedRun,
    written: Callable[[tuple[str, ...]], bytes],
    folder: Path,
    before: dict[float, float],
    lost: Sequence[tuple[str, ...]],
    groups: int,
) -> dict[float, float]:
    """The ratios without some groups of changes; without all the model is that of before."""
    if len(lost) == groups:
        return dict.fromkeys(before, 1.0)
    return _ratios(run, written(tuple(kind for group in lost for kind in group)), folder, before)


def _ratios(run: RecordedRun, content: bytes, folder: Path, before: dict[float, float]) -> dict[float, float]:
    """By length of the windows: the error of a version over that before."""
    with tempfile.NamedTemporaryFile(dir=folder, prefix=".", suffix=".xml") as file:
        file.write(content)
        file.flush()
        after = _errors(run, Path(file.name))
    return {horizon: after[horizon] / max(error, 1e-12) for horizon, error in before.items()}


def _errors(run: RecordedRun, path: Path) -> dict[float, float]:
    """rad or m by length of the windows."""
    arm, last = FreeArm(path, run), float(run.seconds[-1])
    begin = last - _HELD * (last - float(run.seconds[0]))
    lengths = _UNSTABLE if "effort" in arm.driven.values() else _HORIZONS
    return {
        each.horizon: each.mean for each in rolled_out(arm, RolloutOptions(lengths, begin=begin, end=last)).horizons
    }


def _worst(ratios: dict[float, float]) -> float:
    return max(ratios.values())


def _sum(ratios: dict[float, float]) -> float:
    return sum(math.log(max(each, 1e-12)) for each in ratios.values())
