"""What a scene may have wrong: families of scenes with one parameter, and how probable what was seen is in each."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import ndtr

from poise.assembly import Analysis, Assembly, FrictionPair
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about, unit
from poise.mismatch.carried.events import CarriedMotion, height_of
from poise.mismatch.carried.prediction import Loading, loading, mode_at
from poise.mismatch.carried.recorded import GRID_RATE
from poise.types import Array

DECLARED_WITHIN = 0.08
"""One sigma of the limits of a scene that is as declared, as a share."""
_SHARP = 0.03
"""The same of a scene whose parameter is right."""
_TOGETHER = 0.05
"""s within which what is predicted and what is seen are one event, besides the error of its time."""
_OTHER_MODE, _OTHER_OBJECT = 0.02, 0.2
"""Likelihood of seeing the other mode, or another object move first, than is predicted."""
_FRICTION = (0.04, 1.5, 36)
_HEIGHTS = (-0.45, 1.5, 40)
"""Changes of the height of a centre of mass, in heights over the support."""
_TILTS = (np.deg2rad(0.5), np.deg2rad(12.0), 24)
_SLOSH = np.geomspace(0.5, 4.0, 14)
"""Hz of a liquid's first mode."""
_LIQUID, _DAMPING = (0.3, 0.5, 0.7), 0.03
"""Shares of the mass that sloshes, and its damping ratio."""


@dataclass(frozen=True)
class Candidate:
    """A cause with one value of its parameter.

    Args:
        value: of the parameter.
        weight: prior probability among the values.
        scene: with it.
        acceleration: (T, 3) m/s2, that the scene then feels.
        tolerance: one sigma of its limits, as a share.
    """

    value: float
    weight: float
    scene: Assembly
    acceleration: Array
    tolerance: float = _SHARP


@dataclass(frozen=True)
class SceneCause:
    """One cause.

    Args:
        name: of the effect.
        objects: that it is about.
        parameter, unit: of its value.
        prior: probability.
        candidates: makes them.
    """

    name: str
    objects: tuple[str, ...]
    parameter: str
    unit: str
    prior: float
    candidates: Callable[[], Iterator[Candidate]]


def probability(candidate: Candidate, first: CarriedMotion | None, seconds: Array, noise: float) -> float:
    """Of what was seen: the first motion at its time, or none.

    Args:
        candidate: the scene.
        first: what moved first.
        seconds: (T,) of the accelerations.
        noise: m/s2, one sigma of them.
    """
    try:
        found = loading(candidate.scene, candidate.acceleration)
    except PoiseError:  # such a scene cannot be: objects overlap, or fall
        return 0.0
    limit = float(np.linalg.norm(candidate.acceleration, axis=1).max()) / max(float(found.most[-1]), 1e-6)
    spread = float(np.hypot(candidate.tolerance, noise / max(limit, 0.1)))
    if first is None:
        return float(1 - _passed(found.most[-1], spread))
    around = _TOGETHER + 2 * first.deviation
    early, late = (_most_at(found, seconds, first.time + shift) for shift in (-around, around))
    chance = float(_passed(late, spread) - _passed(early, spread))
    if chance < 1e-6:
        return chance
    at = found.crossing(min(1.0, late)) or 0
    mode, movers = mode_at(candidate.scene, candidate.acceleration[at])
    return chance * (1.0 if mode == first.mode else _OTHER_MODE) * (1.0 if first.object in movers else _OTHER_OBJECT)


def _passed(load: float, spread: float) -> float:
    """Probability that something has moved up to this load."""
    return float(ndtr((load - 1) / spread))


def _most_at(found: Loading, seconds: Array, time: float) -> float:
    at = int(np.searchsorted(seconds, time))
    return float(found.most[min(at, len(seconds) - 1)]) if at > 0 else 0.0


def by_chance(found: Loading, first: CarriedMotion, seconds: Array, noise: float) -> float:
    """Of a push at any time, before which the scene as declared does not move."""
    spread = float(np.hypot(DECLARED_WITHIN, noise))
    still = 1 - _passed(_most_at(found, seconds, first.time - _TOGETHER), spread)
    return still * 2 * _TOGETHER / float(seconds[-1] - seconds[0])


def families(scene: Assembly, acceleration: Array, mover: str, way: Array) -> list[SceneCause]:
    """The causes that concern an object.

    Args:
        scene: as declared, with the objects where they stood.
        acceleration: (T, 3) m/s2.
        mover: what moved first, or is predicted to.
        way: (3,) acceleration when it did.
    """
    found = [
        SceneCause("friction", (mover, other), "coefficient", "", 0.22, _rubbing(scene, acceleration, mover, other))
        for other in supporters(scene, mover)
    ]
    shared = [replace(one, prior=one.prior / len(found)) for one in found]
    return [
        *shared,
        SceneCause("com_height", (mover,), "raised_by", "m", 0.15, lambda: _raised(scene, acceleration, mover)),
        SceneCause("tray_tilt", (), "angle", "rad", 0.05, lambda: _tilted(scene, acceleration, way)),
        SceneCause("liquid", (mover,), "frequency", "Hz", 0.06, lambda: _sloshing(scene, acceleration, mover)),
    ]


def supporters(scene: Assembly, name: str) -> list[str]:
    """Ids of what an object touches, and does not lie on it."""
    up = -unit(np.asarray(scene.gravity))
    place = scene.place_of(name)
    found = []
    for block in Analysis.of(scene).blocks:
        for each in block.interfaces:
            if place in (each.first, each.second):
                rests = (each.normal @ up) * (1 if each.second == place else -1)
                if rests > -0.5:
                    found.append(scene.objects[each.first if each.second == place else each.second].id)
    return sorted(set(found))


def _rubbing(scene: Assembly, acceleration: Array, mover: str, other: str) -> Callable[[], Iterator[Candidate]]:
    def made() -> Iterator[Candidate]:
        values = np.geomspace(*_FRICTION)
        for value in values:
            pair = FrictionPair((mover, other), float(value), rolling=scene.rolling_between(mover, other))
            yield Candidate(float(value), 1 / len(values), scene.with_object(pairs=[pair]), acceleration)

    return made


def _raised(scene: Assembly, acceleration: Array, mover: str) -> Iterator[Candidate]:
    item = scene.objects[scene.place_of(mover)]
    up = -unit(np.asarray(scene.gravity))
    height = height_of(scene, mover)
    room = float((item.vertices @ up).max() - item.com_in_world @ up)
    shares = np.linspace(*_HEIGHTS)
    shares = shares[(shares * height < room) & (np.abs(shares) > 0.05)]
    for share in shares:
        com = item.pose.undo(item.com_in_world + share * height * up)
        raised = replace(item, com=com)
        yield Candidate(float(share * height), 1 / len(shares), scene.with_object(raised), acceleration)


def _tilted(scene: Assembly, acceleration: Array, way: Array) -> Iterator[Candidate]:
    """A tray whose uphill side is where the base accelerates to: both make the object move backwards."""
    gravity = np.asarray(scene.gravity)
    up = -unit(gravity)
    level = way - (way @ up) * up
    axis = np.cross(level, up) / max(float(np.linalg.norm(level)), 1e-9)
    for sign in (1.0, -1.0):
        for angle in np.linspace(*_TILTS):
            turn = rotation_about(axis, -sign * angle)
            leaning = gravity - turn @ gravity
            yield Candidate(float(sign * angle), 0.5 / _TILTS[2], scene, acceleration + leaning)


def _sloshing(scene: Assembly, acceleration: Array, mover: str) -> Iterator[Candidate]:
    """A part of the mass that swings: its force follows the acceleration late, exceeds it, and it moves off the middle.

    The weight that is off the middle tips the object as a further acceleration does.
    """
    gravity, height = float(np.linalg.norm(scene.gravity)), height_of(scene, mover)
    for frequency in _SLOSH:
        omega = 2 * np.pi * float(frequency)
        swing = _resonant(acceleration, omega, 1 / GRID_RATE)
        for share in _LIQUID:
            felt = (1 - share) * acceleration + share * (1 + gravity / (omega**2 * height)) * swing
            yield Candidate(float(frequency), 1 / (len(_SLOSH) * len(_LIQUID)), scene, felt)


def _resonant(values: Array, omega: float, step: float) -> Array:
    """(T, 3) response of a resonance of that angular frequency, whose gain is 1 at rest."""
    place, speed = np.zeros(values.shape[1]), np.zeros(values.shape[1])
    found = np.empty_like(values)
    for row, value in enumerate(values):
        speed = speed + step * (omega**2 * (value - place) - 2 * _DAMPING * omega * speed)
        place = place + step * speed
        found[row] = place
    return found


def moved_to(scene: Assembly, poses: dict[str, Pose]) -> Assembly:
    """The scene with objects elsewhere."""
    return scene.with_object(*(replace(scene.objects[scene.place_of(name)], pose=pose) for name, pose in poses.items()))
