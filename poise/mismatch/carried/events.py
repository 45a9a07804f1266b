"""When an object on a base first moves, and how: it slips, or it tips."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from poise.assembly import Assembly
from poise.geometry import unit
from poise.mismatch.carried.recorded import ObjectTrack
from poise.types import Array

_MOVED, _TIPPED = 2e-3, np.deg2rad(1.5)
"""m and rad from which on an object has moved."""
_SIGMAS = 6.0
_LASTING = 2
"""Samples in a row."""
_BACK, _AFTER = 0.5, 0.08
"""s before and after the detection that the beginning is fitted to."""
_LEANS = 0.3
"""Share of the motion of the centre of mass that a rotation explains, from which on the object tips."""


@dataclass(frozen=True)
class CarriedMotion:
    """An object that moved on the base.

    Args:
        object: its id.
        mode: "slip" or "tip".
        time: s, when it began.
        deviation: s, one sigma of that.
        moved, tilted: m and rad, most that it moved.
    """

    object: str
    mode: str
    time: float
    deviation: float
    moved: float
    tilted: float


def motions(tracks: Mapping[str, ObjectTrack], scene: Assembly) -> tuple[CarriedMotion, ...]:
    """What moved, the first one first."""
    found = (_motion(name, track, height_of(scene, name)) for name, track in tracks.items())
    return tuple(sorted((one for one in found if one is not None), key=lambda one: one.time))


def height_of(scene: Assembly, name: str) -> float:
    """m of the centre of mass over the lowest point of the object."""
    item = scene.objects[scene.place_of(name)]
    up = -unit(np.asarray(scene.gravity))
    return float(item.com_in_world @ up - (item.vertices @ up).min())


def _motion(name: str, track: ObjectTrack, height: float) -> CarriedMotion | None:
    moved, tilted = track.moved, _tilted(track)
    at_moved = _first(moved, max(_MOVED, _SIGMAS * track.noise[0]))
    at_tilted = _first(tilted, max(_TIPPED, _SIGMAS * track.noise[1]))
    starts = [at for at in (at_moved, at_tilted) if at is not None]
    if not starts:
        return None
    seen = min(starts)
    after = min(seen + _LASTING, len(moved) - 1)
    leans = tilted[after] * height > _LEANS * moved[after] and tilted[after] > 4 * track.noise[1]
    signal, noise = (height * tilted, height * track.noise[1]) if leans else (moved, track.noise[0])
    time, deviation = _began(track.seconds, signal, noise, seen)
    return CarriedMotion(name, "tip" if leans else "slip", time, deviation, float(moved.max()), float(tilted.max()))


def _tilted(track: ObjectTrack) -> Array:
    """(N,) rad from how the object stood at first."""
    up = track.rotation[:, 2, :]  # the scene's vertical in the object's axes: turning about it is no tipping
    return np.arccos(np.clip(up @ unit(np.median(up[track.first], axis=0)), -1.0, 1.0))


def _first(values: Array, limit: float) -> int | None:
    """Where values begin to stay above a limit for a while."""
    above = np.convolve(values > limit, np.ones(_LASTING), "valid") == _LASTING
    return int(np.argmax(above)) if above.any() else None


def _began(seconds: Array, signal: Array, noise: float, seen: int) -> tuple[float, float]:
    """s, and one sigma: when a motion begins that accelerates steadily from rest."""
    near = (seconds > seconds[seen] - _BACK) & (seconds < seconds[seen] + _AFTER)
    times, values = seconds[near], signal[near]
    level = np.median(values[: max(len(values) // 3, 1)])
    noise = max(noise, 1e-4)
    begins = np.linspace(times[0], seconds[seen], 81)
    costs = []
    for begin in begins:
        shape = np.maximum(times - begin, 0) ** 2
        pull = max(float(shape @ (values - level)) / max(float(shape @ shape), 1e-12), 0.0)
        costs.append(float(np.sum((values - level - pull * shape) ** 2)) / (2 * noise**2))
    weights = np.exp(-(np.array(costs) - min(costs)))
    weights /= weights.sum()
    time = float(weights @ begins)
    spread = float(np.sqrt(weights @ (begins - time) ** 2))
    return time, max(spread, float(np.median(np.diff(times))) / 2)
