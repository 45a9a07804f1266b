"""When an object on a base first moves, and how: it slips, or it tips."""

from dataclasses import dataclass

import numpy as np

from poise.assembly import Assembly
from poise.geometry import unit
from poise.mismatch.carried.onset import onset
from poise.mismatch.carried.recorded import CarriedRecording, ObjectTrack
from poise.types import Array

_MOVED, _TIPPED = 2e-3, np.deg2rad(1.5)
"""m and rad from which on an object has moved."""
_SIGMAS = 5.0
_LENGTHS = (2, 4, 8, 16)
"""Samples in a row whose mean shows it: a small motion in noise takes more of them."""
_BEGUN, _LEANT = 3e-4, np.deg2rad(0.2)
"""m and rad by which it has moved at the time that is reported."""
_LEANS = 0.3
"""Share of the motion of the centre of mass that a rotation explains, from which on the object tips."""
_NORMAL = 1.4826


@dataclass(frozen=True)
class CarriedMotion:
    """An object that moved on the base.

    Args:
        object: its id.
        mode: "slip" or "tip".
        time: s, when it had moved by 0.3 mm, or leaned by 0.2 degrees.
        deviation: s, one sigma of that.
        moved, tilted: m and rad, most that it moved.
        released: s, when what held it gave way.
    """

    object: str
    mode: str
    time: float
    deviation: float
    moved: float
    tilted: float
    released: float = float("nan")


def motions(recording: CarriedRecording, scene: Assembly) -> tuple[CarriedMotion, ...]:
    """What moved, the first one first."""
    found = (_motion(name, track, recording, scene) for name, track in recording.objects.items())
    return tuple(sorted((one for one in found if one is not None), key=lambda one: one.time))


def height_of(scene: Assembly, name: str) -> float:
    """m of the centre of mass over the lowest point of the object."""
    item = scene.objects[scene.place_of(name)]
    up = -unit(np.asarray(scene.gravity))
    return float(item.com_in_world @ up - (item.vertices @ up).min())


def _motion(name: str, track: ObjectTrack, recording: CarriedRecording, scene: Assembly) -> CarriedMotion | None:
    shift, lean = track.translation - track.start.translation, _leaning(track)
    found = [_detected(shift, _MOVED, track), _detected(lean, _TIPPED, track)]
    hits = [one for one in found if one is not None]
    if not hits:
        return None
    seen, length = min(hits)
    height = height_of(scene, name)
    tips = _tips(shift, lean, height, seen, track.noise[1])
    signal, noise = (height * lean, height * track.noise[1]) if tips else (shift, track.noise[0])
    last = slice(max(seen - length // 2, 0), seen + 3)
    way = unit(signal[last].mean(axis=0))
    item = scene.objects[scene.place_of(name)]
    size = float(np.linalg.norm(np.ptp(item.vertices, axis=0)))
    weight = float(np.linalg.norm(scene.gravity))
    released, time, deviation = onset(
        track.seconds,
        signal @ way,
        max(noise, 1e-4),
        seen,
        (recording.seconds, -recording.acceleration @ way),
        1.5 * weight / size if tips else 0.0,
        0.7 if tips else 1.0,
        height * _LEANT if tips else _BEGUN,
        length * float(np.median(np.diff(track.seconds))),
    )
    farthest, most = float(track.moved.max()), float(np.linalg.norm(lean, axis=1).max())
    return CarriedMotion(name, "tip" if tips else "slip", time, deviation, farthest, most, released)


def _tips(shift: Array, lean: Array, height: float, seen: int, noise: float) -> bool:
    soon = slice(seen, seen + 3)
    leans, moves = (float(np.linalg.norm(signal[soon].mean(axis=0))) for signal in (lean, shift))
    return leans * height > _LEANS * moves and leans > 3 * noise


def _leaning(track: ObjectTrack) -> Array:
    """(N, 3) rad by which its vertical leans away from how it stood at first; turning about it is no leaning."""
    there = track.start.rotation  # the scene's vertical in the object's axes at first, as a direction of the object
    vertical = track.rotation @ there.T[:, 2]
    level = vertical * [1, 1, 0]
    angle = np.arctan2(np.linalg.norm(level, axis=1), vertical[:, 2])
    return level * (angle / np.maximum(np.linalg.norm(level, axis=1), 1e-12))[:, None]


def _detected(values: Array, least: float, track: ObjectTrack) -> tuple[int, int] | None:
    """The sample at which means of so many samples, the second figure, show that an object is elsewhere."""
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
    steps = np.diff(values, axis=0)
    alone = _NORMAL * float(np.median(np.abs(steps - np.median(steps, axis=0)))) / np.sqrt(2)
    known = track.first.stop
    hits = []
    for length in (each for each in _LENGTHS if 2 * each < len(values)):
        means = (sums[length:] - sums[:-length]) / length
        apart = means[length:] - means[:-length]
        slow = _NORMAL * float(np.median(np.abs(apart))) / np.sqrt(2)  # of noise that averages less than white noise
        spread = np.hypot(max(alone / np.sqrt(length), slow), 1.25 * alone / np.sqrt(known))
        over = np.linalg.norm(means, axis=1) > max(least, _SIGMAS * spread)
        if over.any():
            hits.append((int(np.argmax(over)) + length - 1, length))
    return min(hits, default=None)
