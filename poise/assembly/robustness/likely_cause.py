"""Why a scene is refused or falls, where one wrong convention, unit or pose explains it: read otherwise, it stands."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import islice

import numpy as np

from poise.assembly.contact import overlapping
from poise.assembly.robustness.other_readings import SceneReading, readings_of_all, readings_of_one
from poise.assembly.scene import Assembly, RigidObject
from poise.assembly.settling import Settled, settle
from poise.assembly.statics import Analysis, Deadline
from poise.errors import ErrorCode, PoiseError
from poise.threads import in_one_thread

EXPLAINED = frozenset({ErrorCode.FLOATING, ErrorCode.INTERPENETRATION, ErrorCode.UNSTABLE})
"""Codes of refusals that another reading of the scene may explain."""
_MOST = 60
"""Objects of scenes that are read otherwise: each reading is settled by itself."""
_SUSPECTS = 4
"""Objects named by a refusal that are read otherwise by themselves."""
_LIKELY = 4.5
"""Sigmas of a reading's errors at most."""
_STRAIN = 1.25
"""Largest move over what is likely: once in some hundred readings the right one is beyond 1."""
_FEW = 3
"""Objects that may move, of which a convention for all is no more likely than another reading of one."""
_NAMED = 2
"""Readings of one object that are said, beside its pose."""
_LOOSE = 0.01
"""m, one sigma of the position of an object that may be elsewhere."""
_NOISIER = (2.0, 4.0, 8.0)
"""Times the stated errors of poses."""


@in_one_thread
def likely_cause(assembly: Assembly, seconds: float = 5.0) -> str | None:
    """A sentence about the convention under which a scene that is refused or falls would stand; None: none was found.

    One convention for all objects is tried first, then others for each object that the refusal names, then its pose,
    and at last larger errors of all poses.

    Args:
        assembly: the objects as they were given, with the uncertainty of their poses.
        seconds: after which no other reading is begun.
    """
    if len(assembly.objects) > _MOST:
        return None
    deadline = Deadline.after(seconds)
    found = list(islice(_standing(readings_of_all(assembly), deadline), 1))
    few = sum(not item.fixed for item in assembly.objects) <= _FEW
    for name in _suspects(assembly)[: 1 if found else None] if few or not found else ():
        found += list(islice(_standing(readings_of_one(assembly, name), deadline), _NAMED))
        found += _misplaced(assembly, name, deadline)
    found = found or list(islice(_standing(_noisier(assembly), deadline), 1))
    return f"the scene stands if {', or if '.join(found)}" if found else None


def _standing(readings: Iterable[SceneReading], deadline: Deadline) -> Iterator[str]:
    """The words of the readings by which the scene stands."""
    for words, read in readings:
        if deadline.passed:
            return
        if _settled(read) is not None:
            yield words


def _settled(read: Callable[[], Assembly]) -> Settled | None:
    """The scene by a reading, if errors of its poses explain it, and it stands."""
    try:
        assembly = read()
        if _overlapping(assembly):
            return None
        settled = settle(assembly)
        stands = settled.strain <= _STRAIN and Analysis.of(settled.assembly).stability().stable
    except PoiseError:
        return None
    return settled if stands else None


def _overlapping(assembly: Assembly) -> list[str]:
    """Objects that overlap by more than errors of their poses explain."""
    found = overlapping(assembly, _LIKELY * np.array([_error(item) for item in assembly.objects]))
    return [assembly.objects[place].id for pair in found for place in pair[:2]]


def _error(item: RigidObject) -> float:
    """m, one sigma of the place of the point of an object that is known least."""
    if item.fixed or item.pose_covariance is None:
        return 0.0
    deviations = np.sqrt(np.diag(item.pose_covariance))
    reach = np.linalg.norm(item.vertices - item.pose.translation, axis=1).max()
    return float(deviations[:3].max() + reach * deviations[3:].max())


def _suspects(assembly: Assembly) -> list[str]:
    """Objects that the refusal names, that fall, or that overlap most."""
    try:
        named = list(Analysis.of(settle(assembly).assembly).stability().falling)
    except PoiseError as error:
        named = [*error.data.get("objects", ()), error.data.get("nearest", "")]
    deepest = _overlapping(assembly)[:_SUSPECTS]
    movable = {item.id for item in assembly.objects if not item.fixed}
    return [name for name in dict.fromkeys([*named[:_SUSPECTS], *deepest]) if name in movable]


def _misplaced(assembly: Assembly, name: str, deadline: Deadline) -> list[str]:
    """That the scene stands with an object at another place or, where it overlaps others, without it."""
    item = assembly.objects[assembly.index[name]]
    known = np.zeros((6, 6)) if item.pose_covariance is None else np.asarray(item.pose_covariance)
    loose = replace(item, pose_covariance=known + np.diag([_LOOSE**2] * 3 + [1e-6] * 3))
    if deadline.passed:
        return []
    settled = _settled(lambda: assembly.with_object(loose))
    if settled is not None:
        step = next(move.translation for move in settled.moves if move.id == name)
        return [f"the pose of {name} is {1e3 * np.linalg.norm(step):.0f} mm off"]
    if (
        name in _overlapping(assembly)
        and len(assembly.objects) > 2
        and _settled(lambda: assembly.without(name)) is not None
    ):
        return [f"{name} is left out: check the pose of {name} and its sizes"]
    return []


def _noisier(assembly: Assembly) -> Iterator[SceneReading]:
    """With larger errors of all poses that are uncertain."""
    for factor in _NOISIER if any(item.pose_covariance is not None for item in assembly.objects) else ():
        yield SceneReading(
            f"errors of poses are {factor:g} times as large as stated", partial(_with_errors, assembly, factor)
        )


def _with_errors(assembly: Assembly, factor: float) -> Assembly:
    return replace(
        assembly,
        objects=tuple(
            item if item.pose_covariance is None else replace(item, pose_covariance=factor**2 * item.pose_covariance)
            for item in assembly.objects
        ),
    )
