"""Planners that propose whole poses and try them one by one: what they share."""

import time
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace

import numpy as np

from poise.assembly import Analysis, Assembly, RigidObject
from poise.errors import ErrorCode
from poise.geometry import Pose
from poise.placement import (
    CancelledError,
    Options,
    Placement,
    PlacementProgress,
    Validator,
    no_placement,
    plan_placement,
    require_new,
)
from poise.types import Array

Proposals = Callable[[Analysis, RigidObject, np.random.Generator], Iterator[Pose | str]]
"""Poses to try, or why there was none in this attempt."""


def first_that_stays(
    proposals: Proposals,
    assembly: Assembly | Analysis,
    item: RigidObject,
    options: Options,
    seed: int,
    progress: Callable[[PlacementProgress], bool] | None,
) -> Placement:
    """Try poses until one is a placement, with the tests of `plan_placement` but without settling.

    Raises:
        InputError, NoAnswerError: as `plan_placement`.
        CancelledError: CANCELLED.
    """
    start = time.monotonic()
    clock = options.deadline_from(start)
    analysis = Analysis.of(assembly, deadline=clock)
    require_new(analysis.assembly.objects, item)
    analysis.require_stable(clock)
    wanted = (
        (("rests on nothing that moves", rests_on_object), *options.tests) if options.on == "objects" else options.tests
    )
    validator = Validator(analysis, item, wanted, options.looks, options.uncertainty, settling=False)
    attempts = 0
    for proposal in proposals(analysis, item, np.random.default_rng(seed)):
        if attempts >= options.attempts or _late(start, options):
            break
        attempts += 1
        accepted = None
        if isinstance(proposal, str):
            validator.rejected[proposal] += 1
        else:
            accepted = validator.accept(proposal)
        best = None if accepted is None else accepted[1]
        if progress is not None and not progress(PlacementProgress(attempts, best, None)):
            raise CancelledError(ErrorCode.CANCELLED, f"placing {item.id} was cancelled; nothing was changed")
        if accepted is not None:
            seconds = time.monotonic() - start
            return Placement(accepted[1], accepted[0], attempts, seconds, dict(validator.rejected))
    raise no_placement(item, validator.rejected, attempts, looks=[name for name, _ in options.looks])


def guided_by(
    guide: str,
    assembly: Assembly | Analysis,
    item: RigidObject,
    options: Options,
    seed: int,
    progress: Callable[[PlacementProgress], bool] | None,
) -> Placement:
    """As `plan_placement`, with another guide (`Options.guide`)."""
    return plan_placement(assembly, item, replace(options, guide=guide), seed, progress)


def rests_on_object(analysis: Analysis, item: RigidObject) -> bool:
    """Whether the object touches something that is not fixed."""
    place, objects = analysis.assembly.index[item.id], analysis.assembly.objects
    sides = [{i.first, i.second} for i in analysis.structure.interfaces]
    return any(place in pair and not any(objects[other].fixed for other in pair) for pair in sides)


def surroundings(analysis: Analysis, size: float) -> Array:
    """(2, 3) m: bounds of the objects that are not fixed (of all when all are), wider by a size."""
    objects = analysis.assembly.objects
    chosen: Iterable[RigidObject] = [item for item in objects if not item.fixed] or objects
    corners = np.concatenate([item.vertices for item in chosen])
    return np.array([corners.min(axis=0) - size, corners.max(axis=0) + size])


def at_random(item: RigidObject, rng: np.random.Generator, com: Array) -> Pose:
    """A random orientation of the object with its centre of mass at (3,) m."""
    x, y, z, w = rng.normal(size=4)
    turned = Pose.from_vector([0, 0, 0, *(np.array([x, y, z, w]) / np.linalg.norm([x, y, z, w]))])
    inside = replace(item, pose=Pose(np.eye(3), np.zeros(3))).com_in_world
    return Pose(turned.rotation, com - turned.rotation @ inside)


def radius(item: RigidObject) -> float:
    """m, of the sphere about the centre of mass that holds the object."""
    return float(np.linalg.norm(item.vertices - item.com_in_world, axis=1).max())


def _late(start: float, options: Options) -> bool:
    return options.deadline is not None and time.monotonic() - start >= options.deadline
