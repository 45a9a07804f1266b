"""What each part of a scene did while the base moved, and how probable that is for given limits.

A part is what touches each other without the fixed objects. What did not move is evidence, too: it withstood all
accelerations of the recording. Two parts share a tilt of the base, but no friction and no centre of mass.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from poise.assembly import Analysis, Assembly
from poise.mismatch.carried.events import CarriedMotion
from poise.mismatch.carried.prediction import Loading, SceneLimits, mode_at
from poise.mismatch.carried.recorded import CarriedRecording, ObjectTrack
from poise.types import Array

_TOGETHER = 0.05
"""s within which what is predicted and what is seen are one event, besides the error of its time."""
_OTHER_MODE, _OTHER_OBJECT = 0.02, 0.2
"""Likelihood of seeing the other mode, or another object move first, than is predicted."""
_WAYS, _OTHER_WAY = {"slip": np.deg2rad(20.0), "tip": np.deg2rad(40.0)}, 0.1
"""rad, one sigma of the direction of a motion against that of the force that causes it (an object tips over an edge),
and the probability that the direction says nothing."""
_STEADY, _PER, _SUDDEN = 8.0, 3.0, 4.0
"""How much better a steady acceleration of free size fits that as probably follows a push as not (development cases:
caused motions -5 to 7, nine of ten slips after a push over 18), what one more of it counts, and most that the course of
a motion says, in logarithms of a probability."""
_ROCKS, _BARELY, _ROCKED = 0.6, 1.2, 0.1
"""s within which an object that was barely lifted falls back and leans the other way, the load over the limit that
barely lifts it, and the probability of that."""
_SOMETHING_ELSE = 0.01
"""Probability that a part does what a cause elsewhere does not explain."""
_UPRIGHT = np.deg2rad(10.0)
_NEAR = 0.01
"""m of free space in which an object that moved may have touched another one."""


@dataclass(frozen=True, eq=False)
class Part:
    """Objects that touch each other.

    Args:
        scene: these and the fixed ones.
        names: of those that can move.
        first: what moved first, if something did.
        until: s up to which they are undisturbed by objects of other parts.
    """

    scene: Assembly
    names: tuple[str, ...]
    first: CarriedMotion | None
    until: float


def parts_of(recording: CarriedRecording, scene: Assembly, seen: Sequence[CarriedMotion]) -> list[Part]:
    """The parts of a scene some object of which has poses."""
    found = []
    for block in Analysis.of(scene).blocks:
        numbers = {each for one in block.interfaces for each in (one.first, one.second)}
        members = tuple(scene.objects[n].id for n in sorted(numbers) if not scene.objects[n].fixed)
        if not any(name in recording.objects for name in members):
            continue
        until = min((_touched(recording, scene, one, members) for one in seen), default=float("inf"))
        until = min(until, float(recording.seconds[-1]))
        first = next((one for one in seen if one.object in members and one.time <= until), None)
        found.append(Part(_only(scene, members), members, first, until))
    return found


def _only(scene: Assembly, names: Sequence[str]) -> Assembly:
    items = tuple(item for item in scene.objects if item.fixed or item.id in names)
    known = {item.id for item in items}
    pairs = tuple(pair for pair in scene.friction_pairs if known.issuperset(pair.objects))
    return replace(scene, objects=items, friction_pairs=pairs)


def _touched(recording: CarriedRecording, scene: Assembly, mover: CarriedMotion, members: Sequence[str]) -> float:
    """s when an object that moved may have reached others."""
    track = recording.objects[mover.object]
    if mover.object in members:
        return float("inf")
    level, whole = _radii(scene, mover.object)
    reach = np.where(_leans(track), whole, level)
    times = []
    for name in members:
        place = scene.objects[scene.place_of(name)].pose.translation
        apart = np.linalg.norm((track.translation - place)[:, :2], axis=1)
        near = (apart < reach + _radii(scene, name)[0] + _NEAR) & (track.seconds > mover.time)
        times += [float(track.seconds[np.argmax(near)])] if near.any() else []
    return min(times, default=float("inf"))


def _leans(track: ObjectTrack) -> Array:
    return np.asarray(np.einsum("tij,ij->ti", track.rotation, track.start.rotation)[:, 2] < np.cos(_UPRIGHT))


def _radii(scene: Assembly, name: str) -> tuple[float, float]:
    """m, of an object from above, and at its longest."""
    item = scene.objects[scene.place_of(name)]
    off = item.vertices - item.pose.translation
    return float(np.linalg.norm(off[:, :2], axis=1).max()), 2 * float(np.linalg.norm(off, axis=1).max())


def probability(
    limits: SceneLimits, acceleration: Array, tolerance: float, part: Part, seconds: Array, noise: float
) -> float:
    """Of what a part did: its first motion at its time, or none.

    Args:
        limits: of the part.
        acceleration: (T, 3) m/s2 that it feels.
        tolerance: one sigma of its limits, as a share.
        part: what was seen.
        seconds: (T,) of the accelerations.
        noise: m/s2, one sigma of them.
    """
    found, first = limits.loading(acceleration), part.first
    spread = _spread(found, acceleration, tolerance, noise)
    if first is None:
        return 1 - _passed(_most_at(found, seconds, part.until), spread)
    around = _TOGETHER + 2 * first.deviation
    begin, end = first.released - around, first.time + around

    def gives_way(start: float, stop: float, over: float, sense: float) -> float:
        """Between two times, s, at a load of at most `over`, towards where it was seen to move, or away from there."""
        early, late = _most_at(found, seconds, start), _most_at(found, seconds, stop)
        chance = _passed(late, spread) - _passed(max(early, late / over), spread)
        near = np.flatnonzero((seconds >= start) & (seconds <= stop))
        if chance < 1e-9 or not len(near):
            return max(chance, 0.0)
        # what the strongest acceleration of that time asks for, not what came before and was withstood
        strongest = acceleration[near[np.argmax(found.load[near])]]
        chance *= _of_mode(limits.tips_by(strongest), first.mode, tolerance) * _of_way(first, sense * strongest)
        moves = len(part.names) == 1 or first.object in mode_at(part.scene, strongest)[1]
        return chance * (1.0 if moves else _OTHER_OBJECT)

    chance = gives_way(begin, end, np.inf, 1.0)
    if first.mode == "tip":
        chance = (1 - _ROCKED) * chance + _ROCKED * gives_way(begin - _ROCKS, begin, _BARELY, -1.0)
    return chance


def _of_mode(tips_by: float, mode: str, tolerance: float) -> float:
    """Likelihood of a mode, where the limits of both have an error."""
    tips = float(ndtr(tips_by / (np.sqrt(2) * tolerance)))
    right = tips if mode == "tip" else 1 - tips
    return right + _OTHER_MODE * (1 - right)


def _of_way(first: CarriedMotion, acceleration: Array) -> float:
    """Probability density of the direction of a motion that an acceleration causes, over that of any direction."""
    if not first.way:
        return 1.0
    off = np.arctan2(*np.flip(-acceleration[:2])) - np.arctan2(*np.flip(first.way))
    off, spread = float(np.arctan2(np.sin(off), np.cos(off))), _WAYS[first.mode]
    density = np.sqrt(2 * np.pi) / spread * np.exp(-0.5 * (off / spread) ** 2)
    return float((1 - _OTHER_WAY) * density + _OTHER_WAY)


def of_course(part: Part, pushed: bool) -> float:
    """Likelihood of the course of a motion, after a push or under the base's acceleration; 1 on average."""
    if part.first is None:
        return 1.0
    sudden = float(np.clip((part.first.sudden - _STEADY) / _PER, -_SUDDEN, _SUDDEN))
    return float(2 / (1 + np.exp(-sudden if pushed else sudden)))


def by_chance(part: Part, seconds: Array) -> float:
    """Of a motion, or of none, for no reason that the scene has."""
    if part.first is None:
        return 1.0
    return min(2 * (_TOGETHER + 2 * part.first.deviation) / float(seconds[-1] - seconds[0]), 1.0)


def undisturbed(
    limits: SceneLimits, acceleration: Array, tolerance: float, part: Part, seconds: Array, noise: float
) -> float:
    """Probability that a part had not moved before it did; the arguments are those of `probability`."""
    found = limits.loading(acceleration)
    end = part.until if part.first is None else part.first.released - _TOGETHER
    return 1 - _passed(_most_at(found, seconds, end), _spread(found, acceleration, tolerance, noise))


def elsewhere(chance: float, part: Part, seconds: Array) -> float:
    """The probability of what a part did, for a cause that does not concern it."""
    return (1 - _SOMETHING_ELSE) * chance + _SOMETHING_ELSE * by_chance(part, seconds)


def _spread(found: Loading, acceleration: Array, tolerance: float, noise: float) -> float:
    """One sigma of a load, as a share of the limit: of the limit itself, and of accelerations with noise in m/s2."""
    limit = float(np.linalg.norm(acceleration, axis=1).max()) / max(float(found.most[-1]), 1e-6)
    return float(np.hypot(tolerance, noise / max(limit, 0.1)))


def _passed(load: float, spread: float) -> float:
    """Probability that something has moved up to this load."""
    return float(ndtr((load - 1) / spread))


def _most_at(found: Loading, seconds: Array, time: float) -> float:
    at = int(np.searchsorted(seconds, time))
    return float(found.most[min(at, len(seconds) - 1)]) if at > 0 else 0.0
