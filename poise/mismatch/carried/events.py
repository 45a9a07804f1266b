"""When an object on a base first moves, and how: it slips, or it tips."""

from dataclasses import dataclass

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from poise.assembly import Assembly
from poise.geometry import unit
from poise.mismatch.carried.onset import onset
from poise.mismatch.carried.recorded import CarriedRecording, ObjectTrack
from poise.types import Array

_MOVED, _TIPPED = 2e-3, np.deg2rad(1.5)
"""m and rad from which on an object has moved."""
_SIGMAS = {2: 7.0, 4: 6.0, 8: 5.0, 16: 5.0}
"""Deviations of the mean of so many samples that show it: a small motion in noise takes more of them."""
_OUTLIER, _AROUND = 3.5, 5
"""Deviations from the median of so many samples from which on a sample is an outlier, and replaced by it."""
_BEGUN, _LEANT = 3e-4, np.deg2rad(0.2)
"""m and rad by which it has moved at the time that is reported."""
_SOON, _SURE = 4, 1.5
"""Samples that show how it moves; standard deviations of one by which it then leans, if it tips."""
_LOWER, _OF_NORMAL = 0.25, 0.3186
"""A quantile of what steps of noise are, and where that of the absolute values of a normal distribution is."""
_LEVEL = 0.5
"""Horizontal part of the direction of a motion from which it has a direction in the plane."""


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
        way: (x, y) direction of its first motion in the scene, a unit vector; () where none is known.
        sudden: log likelihood of a steady acceleration, as after a push, over that of what the base can cause.
    """

    object: str
    mode: str
    time: float
    deviation: float
    moved: float
    tilted: float
    released: float = float("nan")
    way: tuple[float, ...] = ()
    sudden: float = 0.0


def motions(recording: CarriedRecording, scene: Assembly) -> tuple[CarriedMotion, ...]:
    """What moved, the first one first."""
    found = (_motion(name, track, recording, scene) for name, track in recording.objects.items())
    return tuple(sorted((one for one in found if one is not None), key=lambda one: one.time))


def height_of(scene: Assembly, name: str) -> float:
    """m of the centre of mass over the lowest point of the object."""
    item = scene.objects[scene.place_of(name)]
    up = -unit(np.asarray(scene.gravity))
    return float(item.com_in_world @ up - (item.vertices @ up).min())


def _over(scene: Assembly, name: str) -> float:
    """m of the object's frame over its lowest point."""
    item = scene.objects[scene.place_of(name)]
    up = -unit(np.asarray(scene.gravity))
    return float(item.pose.translation @ up - (item.vertices @ up).min())


def _motion(name: str, track: ObjectTrack, recording: CarriedRecording, scene: Assembly) -> CarriedMotion | None:
    shift = _cleaned(track.translation - track.start.translation, track.noise[0])
    lean = _cleaned(_leaning(track), track.noise[1])
    found = [
        _detected(shift[:, :2], _MOVED, track.noise[0], track),  # nothing slips upwards, and what tips leans
        _detected(lean, _TIPPED, track.noise[1], track),
    ]
    hits = [one for one in found if one is not None]
    if not hits:
        return None
    seen, length = min(hits)
    height = height_of(scene, name)
    tips = _tips(shift, lean, _over(scene, name), seen, track.noise)
    signal, noise = (height * lean, height * track.noise[1]) if tips else (shift, track.noise[0])
    last = slice(max(seen - length // 2, 0), seen + 3)
    way = unit(signal[last].mean(axis=0))
    item = scene.objects[scene.place_of(name)]
    size = float(np.linalg.norm(np.ptp(item.vertices, axis=0)))
    weight = float(np.linalg.norm(scene.gravity))
    released, time, deviation, sudden = onset(
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
    level = tuple(unit(way[:2]).tolist()) if np.linalg.norm(way[:2]) > _LEVEL else ()
    mode = "tip" if tips else "slip"
    return CarriedMotion(name, mode, time, deviation, farthest, most, released, level, sudden)


def _tips(shift: Array, lean: Array, over: float, seen: int, noise: tuple[float, float]) -> bool:
    """Whether a rotation about its lowest points, `over` m below its frame, explains the motion better than none."""
    soon = slice(seen, seen + _SOON)
    moved, leant = shift[soon].mean(axis=0), lean[soon].mean(axis=0)
    rotated = np.linalg.norm((moved - over * leant)[:2]) / np.hypot(max(noise[0], 1e-4), over * noise[1])
    upright = np.linalg.norm(leant) / max(noise[1], 1e-4)
    return bool(rotated < upright and upright > _SURE)


def _leaning(track: ObjectTrack) -> Array:
    """(N, 3) rad by which its vertical leans away from how it stood at first; turning about it is no leaning."""
    there = track.start.rotation  # the scene's vertical in the object's axes at first, as a direction of the object
    vertical = track.rotation @ there.T[:, 2]
    level = vertical * [1, 1, 0]
    angle = np.arctan2(np.linalg.norm(level, axis=1), vertical[:, 2])
    return np.asarray(level * (angle / np.maximum(np.linalg.norm(level, axis=1), 1e-12))[:, None])


def _cleaned(values: Array, noise: float) -> Array:
    """(N, K) without outliers (Hampel's filter)."""
    half = _AROUND // 2
    padded = np.pad(values, ((half, half), (0, 0)), mode="edge")
    middle = np.median(sliding_window_view(padded, _AROUND, axis=0), axis=-1)
    return np.where(np.abs(values - middle) > _OUTLIER * noise, middle, values)


def _detected(values: Array, least: float, noise: float, track: ObjectTrack) -> tuple[int, int] | None:
    """The sample at which the mean of so many samples, the second figure, shows that an object is elsewhere."""
    sums = np.cumsum(np.vstack([np.zeros(values.shape[1]), values]), axis=0)
    known = track.first.stop
    hits = []
    for length, sigmas in ((each, sigmas) for each, sigmas in _SIGMAS.items() if 2 * each < len(values)):
        means = (sums[length:] - sums[:-length]) / length
        apart = np.abs(means[length:] - means[:-length])
        slow = float(np.quantile(apart, _LOWER)) / _OF_NORMAL / np.sqrt(2)  # noise that averages less than white noise
        spread = np.hypot(max(noise / np.sqrt(length), slow), 1.25 * noise / np.sqrt(known))
        over = np.linalg.norm(means, axis=1) > max(least, sigmas * spread)
        if over.any():
            hits.append((int(np.argmax(over)) + length - 1, length))
    return min(hits, default=None)
