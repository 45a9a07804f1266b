"""In which order an assembly can be taken apart without anything else moving."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.scene import Assembly
from poise.assembly.statics import Analysis, Deadline

# Objects looked at before the best order so far is returned.
_TRIES = 2000
# An object carries another when the normal between them rises by more than this (sine).
_RISE = 0.1


@dataclass(frozen=True)
class Disassembly:
    """An order of removal.

    Args:
        order: ids, the first to take first.
        safe: whether taking each, in this order, moves nothing else.
        margins: N, of what stands afterwards (inf when nothing is left; negative when something falls).
        complete: every order that might be safe was looked at, or this one is; otherwise the deadline passed before.
    """

    order: tuple[str, ...]
    safe: tuple[bool, ...]
    margins: tuple[float, ...]
    complete: bool


def plan_disassembly(
    assembly: Assembly | Analysis, target: str | None = None, deadline: float | None = None
) -> Disassembly:
    """Find an order in which each object can be taken while all others stay where they are.

    Whether the rest stands is solved again without the object: the thesis' test (section 4.6.3: the force that lifts
    the object equals its weight) is not the same where objects touch at their sides, since friction there changes
    the force to lift though nothing depends on the object. Of the objects that may go, those on which nothing rests go
    first, then those that leave the most margin; dead ends are taken back.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        target: take this object, and before it only what has to go first; None: everything.
        deadline: s; then the rest of the order is marked as not safe.

    Raises:
        InputError: OBJECT_UNKNOWN; INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    clock = Deadline.after(deadline)
    analysis = Analysis.of(assembly)
    analysis.require_stable(clock)
    if target is not None:
        analysis.assembly.place_of(target)
        return _free(analysis, target, clock)
    return _take_apart(analysis, clock)


@dataclass(frozen=True, eq=False)
class _Step:
    """One object taken, and what is left."""

    name: str
    left: Analysis
    clock: Deadline

    @cached_property
    def margin(self) -> float:
        """N; -inf, too, when the deadline passed before it was known. Nothing stands at 0."""
        found = self.left.stability(self.clock)
        return -np.inf if found.doubtful else found.margin


def _steps(analysis: Analysis, clock: Deadline) -> list[_Step]:
    """All objects without which the rest stands: first those that carry nothing, then by the margin left."""
    steps = []
    for place in analysis.structure.movable:
        if clock.passed:
            break
        name = analysis.assembly.objects[place].id
        step = _Step(name, analysis.without(name), clock)
        if step.margin > 0:
            steps.append(step)
    carrying = _carrying(analysis)
    return sorted(steps, key=lambda step: (step.name in carrying, -step.margin))


def _carrying(analysis: Analysis) -> set[str]:
    """Ids of the objects on which others rest."""
    up = -np.asarray(analysis.assembly.gravity)
    objects = analysis.assembly.objects
    found = set()
    for interface in analysis.structure.interfaces:
        rise = float(interface.normal @ up) / (float(np.linalg.norm(up)) or 1.0)
        if abs(rise) > _RISE:
            found.add(objects[interface.first if rise > 0 else interface.second].id)
    return found


def _take_apart(analysis: Analysis, clock: Deadline) -> Disassembly:
    """Depth first through the orders in which the rest always stands; sets seen to be dead ends are skipped."""
    dead: set[frozenset[str]] = set()
    path: list[_Step] = []
    best: list[_Step] = []
    choices = [_steps(analysis, clock)]
    tries = 0
    while choices and tries < _TRIES and not clock.passed:
        tries += 1
        if len(path) > len(best):
            best = list(path)
        left = path[-1].left if path else analysis
        if not left.structure.movable:
            break
        while choices[-1] and _left_over(choices[-1][0].left) in dead:
            choices[-1].pop(0)
        if choices[-1]:
            path.append(choices[-1].pop(0))
            choices.append(_steps(path[-1].left, clock))
        else:
            dead.add(_left_over(left))
            choices.pop()
            if path:
                path.pop()
    if len(path) > len(best):
        best = list(path)
    names = [step.name for step in best]
    margins = [step.margin for step in best]
    rest = best[-1].left if best else analysis
    exhausted = not choices or not rest.structure.movable
    return _with_rest(rest, names, margins, exhausted)


def _left_over(analysis: Analysis) -> frozenset[str]:
    return frozenset(analysis.assembly.objects[place].id for place in analysis.structure.movable)


def _with_rest(rest: Analysis, names: list[str], margins: list[float], complete: bool) -> Disassembly:
    """An order that goes on, unsafely, through what is left: the highest first."""
    safe = [True] * len(names)
    objects = rest.assembly.objects
    for place in sorted(rest.structure.movable, key=lambda place: -objects[place].com_in_world[2]):
        names.append(objects[place].id)
        safe.append(False)
        margins.append(-float("inf"))
    return Disassembly(tuple(names), tuple(safe), tuple(margins), complete)


def _free(analysis: Analysis, target: str, clock: Deadline) -> Disassembly:
    """Take what would fall without the target, before it; what would fall without that, before that; and so on."""
    steps: list[_Step] = []
    waiting = [target]
    while waiting and not clock.passed:
        left = steps[-1].left if steps else analysis
        if waiting[-1] not in left.assembly.index:
            waiting.pop()
            continue
        step = _Step(waiting[-1], left.without(waiting[-1]), clock)
        if step.margin > 0:
            steps.append(step)
            waiting.pop()
            continue
        falls = [name for name in step.left.stability(clock).falling if name not in waiting]
        if not falls:  # each needs the other
            break
        waiting.append(falls[-1])
    names, margins = [step.name for step in steps], [step.margin for step in steps]
    safe = [True] * len(steps)
    if target not in names:
        left = steps[-1].left if steps else analysis
        names.append(target)
        safe.append(False)
        margins.append(left.without(target).stability().margin)
    return Disassembly(tuple(names), tuple(safe), tuple(margins), not clock.passed)
