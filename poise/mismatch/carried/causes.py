"""What a scene may have wrong: families of scenes with one parameter."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.signal import bilinear, lfilter

from poise.assembly import Analysis, Assembly, FrictionPair
from poise.geometry import Pose, plane_axes, rotation_about, unit
from poise.mismatch.carried.events import height_of
from poise.mismatch.carried.recorded import GRID_RATE
from poise.types import Array

DECLARED_WITHIN = 0.08
"""One sigma of the limits of a scene that is as declared, as a share."""
_LOOSE = 0.05
"""The same of one with a liquid, whose share and height are not known well."""
_SHARP = 0.03
"""The same of a scene whose parameter is right."""
_FRICTION = (0.04, 1.5, 36)
_HEIGHTS = (-0.45, 1.5, 40)
"""Changes of the height of a centre of mass, in heights over the support."""
_TILTS, _WAYS = (np.deg2rad(0.5), np.deg2rad(12.0), 16), 24
"""rad, and directions."""
_SLOSH = np.geomspace(0.5, 4.0, 28)
"""Hz of a liquid's first mode."""
_LIQUID, _DAMPING = (0.3, 0.5, 0.7), 0.03
"""Shares of the mass that sloshes, and its damping ratio."""


@dataclass(frozen=True)
class Candidate:
    """A cause with one value of its parameter.

    Args:
        value: of the parameter.
        weight: prior probability among the values.
        scene: with it; None: as declared.
        acceleration: (T, 3) m/s2, that it then feels.
        tolerance: one sigma of its limits, as a share.
        swings: a part of the object moves by itself, so that the base does not give its course.
    """

    value: float
    weight: float
    scene: Assembly | None
    acceleration: Array
    tolerance: float = _SHARP
    swings: bool = False


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


def families(scene: Assembly, acceleration: Array, mover: str) -> list[SceneCause]:
    """The causes that concern an object.

    Args:
        scene: as declared, with the objects where they stood.
        acceleration: (T, 3) m/s2.
        mover: what moved first, or is predicted to.
    """
    found = [
        SceneCause("friction", (mover, other), "coefficient", "", 0.22, _rubbing(scene, acceleration, mover, other))
        for other in supporters(scene, mover)
    ]
    shared = [replace(one, prior=one.prior / len(found)) for one in found]
    return [
        *shared,
        SceneCause("com_height", (mover,), "raised_by", "m", 0.15, lambda: _raised(scene, acceleration, mover)),
        SceneCause("liquid", (mover,), "frequency", "Hz", 0.06, lambda: _sloshing(scene, acceleration, mover)),
    ]


def tilt(scene: Assembly, acceleration: Array) -> SceneCause:
    """The cause that concerns all objects."""
    return SceneCause("tray_tilt", (), "angle", "rad", 0.06, lambda: _tilted(scene, acceleration))


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


def _tilted(scene: Assembly, acceleration: Array) -> Iterator[Candidate]:
    """A tray that leans by an angle in any direction."""
    gravity = np.asarray(scene.gravity)
    first, second = plane_axes(unit(gravity)[None])[0]
    for way in np.linspace(0, 2 * np.pi, _WAYS, endpoint=False):
        for angle in np.linspace(*_TILTS):
            turn = rotation_about(np.cos(way) * first + np.sin(way) * second, angle)
            leaning = acceleration + gravity - turn @ gravity
            yield Candidate(float(angle), 1 / (_TILTS[2] * _WAYS), None, leaning, DECLARED_WITHIN)


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
            yield Candidate(float(frequency), 1 / (len(_SLOSH) * len(_LIQUID)), None, felt, _LOOSE, True)


def _resonant(values: Array, omega: float, step: float) -> Array:
    """(T, 3) response of a resonance of that angular frequency, whose gain is 1 at rest."""
    system = bilinear([omega**2], [1.0, 2 * _DAMPING * omega, omega**2], 1 / step)
    return np.asarray(lfilter(*system, values, axis=0))


def moved_to(scene: Assembly, poses: dict[str, Pose]) -> Assembly:
    """The scene with objects elsewhere."""
    return scene.with_object(*(replace(scene.objects[scene.place_of(name)], pose=pose) for name, pose in poses.items()))
