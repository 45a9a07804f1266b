"""Planners `sim-above` and `sim-random`: a dynamics simulation finds where the object comes to rest (5.6.1)."""

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from poise.assembly import Analysis, RigidObject
from poise.baselines.placement.engine import Engine
from poise.baselines.placement.trials import at_random, radius, surroundings
from poise.geometry import Pose

_STEP = 1 / 240
"""s, as the thesis' engine."""
_GENTLE = 0.1
"""m/s2, of gravity while falling."""
_SINKING = 0.01
"""m/s, at the start."""
_DAMPING = 2.0
_LONGEST = 10.0
"""s of falling, after which an attempt is given up."""
_AT_REST = 1e-4
"""m/s."""
_CHECKED = 100
"""Steps under full gravity."""
_SIGNIFICANT = 2e-3
"""m: objects that were there may not move farther."""


def from_above(analysis: Analysis, item: RigidObject, rng: np.random.Generator) -> Iterator[Pose | str]:
    """Drop the object in a random orientation from slightly above the objects."""
    size = radius(item)
    low, high = surroundings(analysis, 0.0)
    drop = _Drop(analysis, item)
    while True:
        across = rng.uniform(low[:2], high[:2])
        yield drop.from_pose(at_random(item, rng, np.append(across, high[2] + size)))


def from_anywhere(analysis: Analysis, item: RigidObject, rng: np.random.Generator) -> Iterator[Pose | str]:
    """Let go of the object at a random pose in the vicinity of the objects."""
    bounds = surroundings(analysis, radius(item))
    drop = _Drop(analysis, item)
    while True:
        pose = at_random(item, rng, np.asarray(rng.uniform(*bounds)))
        yield drop.from_pose(pose)


class _Drop:
    """The scene in the engine with the object in it, used again for every attempt."""

    def __init__(self, analysis: Analysis, item: RigidObject) -> None:
        assembly = analysis.assembly
        self._engine = Engine(replace(assembly, objects=(*assembly.objects, item)), _STEP, damping=_DAMPING)
        self._id, self._gravity = item.id, np.asarray(assembly.gravity)
        self._floor = float(min(other.vertices[:, 2].min() for other in assembly.objects))
        self._there = {other.id: other.pose for other in assembly.objects if not other.fixed}

    def from_pose(self, pose: Pose) -> Pose | str:
        engine, size = self._engine, float(np.linalg.norm(self._gravity))
        engine.restart()
        engine.put(self._id, pose, _SINKING * self._gravity / size)
        engine.set_gravity(_GENTLE * self._gravity / size)
        for _ in range(round(_LONGEST / (24 * _STEP))):
            engine.run(24 * _STEP)
            if engine.pose(self._id).translation[2] < self._floor:
                return "falls off"
            if engine.speed(self._id) < _AT_REST:
                break
        else:
            return "does not come to rest"
        engine.set_gravity(self._gravity)
        rest = engine.pose(self._id)
        engine.run(_CHECKED * _STEP)
        if engine.moved(self._there) > _SIGNIFICANT or engine.moved({self._id: rest}) > _SIGNIFICANT:
            return "moves under full gravity"
        return engine.pose(self._id)
