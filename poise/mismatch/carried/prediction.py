"""When a scene on a base is predicted to move: the acceleration against the limits of the assembly engine."""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from poise.assembly import Analysis, Assembly, acceleration_limits
from poise.assembly.robustness import AccelerationLimits
from poise.types import Array

_ASKED = 24
"""Directions of the recorded acceleration in which limits are computed."""
_AROUND = 8
"""Level directions beside those that `acceleration_limits` adds."""
_STRONG = 0.3
"""Share of the largest acceleration from which on a direction is one of them."""
_ROUGH, _SMOOTH = 5.0, 0.5
"""Coefficient of friction with which nothing slips, and a factor of friction with which most things slip."""
_SLIPS = 0.97
"""Share of the limit without slipping below which an object slips."""
_CERTAIN = 20.0
"""Load of a scene that does not even stand."""


@dataclass(frozen=True, eq=False)
class Loading:
    """How near a scene is to moving, over a recording.

    Args:
        load: (T,) the acceleration over its limit: from 1 on something moves.
        most: (T,) the largest load so far.
    """

    load: Array
    most: Array

    def crossing(self, level: float = 1.0) -> int | None:
        """The first sample of at least this load."""
        over = self.most >= level
        return int(np.argmax(over)) if over.any() else None


def loading(scene: Assembly, acceleration: Array) -> Loading:
    """The load of a scene under accelerations (T, 3), m/s2, in its frame."""
    analysis = Analysis.of(scene)
    if not analysis.stability().stable:
        load = np.full(len(acceleration), _CERTAIN)
        return Loading(load, load)
    found = acceleration_limits(analysis, _directions(acceleration), turning=False)
    inside = _inside(found, acceleration)
    size = np.linalg.norm(acceleration, axis=1)
    nearest = np.argmax(acceleration @ found.directions.T, axis=1)
    aligned = np.einsum("ti,ti->t", acceleration, found.directions[nearest]) > 0.9995 * size
    direct = size / np.maximum(found.limits[nearest], 1e-9)
    load = np.where(aligned & (size > 0), direct, inside)
    return Loading(load, np.maximum.accumulate(load))


@dataclass(frozen=True, eq=False)
class SceneLimits:
    """A scene with its limits in all directions, for many accelerations; `limits` is None if it does not stand."""

    scene: Assembly
    limits: AccelerationLimits | None

    @classmethod
    def of(cls, scene: Assembly) -> "SceneLimits":
        """Compute them.

        Raises:
            PoiseError: such a scene cannot be: objects overlap, or fall.
        """
        analysis = Analysis.of(scene)
        if not analysis.stability().stable:
            return cls(scene, None)
        return cls(scene, acceleration_limits(analysis, _AROUND, turning=False))

    def loading(self, acceleration: Array) -> Loading:
        """The load under accelerations (T, 3), m/s2, in its frame."""
        if self.limits is None:
            load = np.full(len(acceleration), _CERTAIN)
            return Loading(load, load)
        load = _inside(self.limits, acceleration)
        return Loading(load, np.maximum.accumulate(load))

    @cached_property
    def without_slipping(self) -> AccelerationLimits:
        """The limits of tipping alone."""
        return acceleration_limits(_roughened(self.scene), _AROUND, turning=False)

    @cached_property
    def smooth(self) -> AccelerationLimits:
        """The limits with half of the friction."""
        return acceleration_limits(_with_friction(self.scene, lambda known: _SMOOTH * known), _AROUND, turning=False)

    def tips_by(self, acceleration: Array) -> float:
        """Logarithm of the limit of slipping over that of tipping, along an acceleration (3,): tipping is first if > 0.

        The limit of slipping is proportional to friction. It is not known beyond twice the limit of tipping.
        """
        if self.limits is None:
            return float("inf")
        tips, slips = (float(_inside(found, acceleration[None])[0]) for found in (self.without_slipping, self.smooth))
        return float(np.log(max(tips, 1e-9) / max(_SMOOTH * slips, 1e-9)))


def _inside(found: AccelerationLimits, acceleration: Array) -> Array:
    """(T,) load by the polytope of the limits."""
    return np.asarray(np.maximum((acceleration @ found.normals.T) / np.maximum(found.offsets, 1e-9), 0).max(axis=1))


def mode_at(scene: Assembly, acceleration: Array) -> tuple[str, tuple[str, ...]]:
    """How a scene moves, "slip" or "tip", and what moves first, under an acceleration (3,) that grows."""
    asked = acceleration[None] / max(float(np.linalg.norm(acceleration)), 1e-9)
    analysis = Analysis.of(scene)
    if not analysis.stability().stable:
        return "tip", ()
    found = acceleration_limits(analysis, asked, turning=False)
    tips = acceleration_limits(_roughened(scene), asked, turning=False).limits[0]
    return ("slip" if found.limits[0] < _SLIPS * tips else "tip"), found.first_to_move[0]


def _with_friction(scene: Assembly, law: Callable[[float], float]) -> Assembly:
    """A scene with other coefficients of friction."""
    pairs = tuple(replace(pair, coefficient=law(pair.coefficient)) for pair in scene.friction_pairs)
    return replace(scene, friction=None if scene.friction is None else law(scene.friction), friction_pairs=pairs)


def _roughened(scene: Assembly) -> Assembly:
    """A scene in which nothing slips."""
    return _with_friction(scene, lambda _: _ROUGH)


def _directions(acceleration: Array) -> Array:
    """(D, 3) unit vectors of the strongest accelerations, all different."""
    size = np.linalg.norm(acceleration, axis=1)
    strong = np.flatnonzero(size > _STRONG * size.max()) if size.max() > 0 else np.array([], int)
    units: list[Array] = []
    for row in strong[np.argsort(-size[strong])]:
        way = acceleration[row] / size[row]
        if all(way @ other < 0.998 for other in units):
            units.append(way)
        if len(units) == _ASKED:
            break
    return np.array(units) if units else np.eye(3)[:1]
