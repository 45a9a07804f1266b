"""In which order an assembly can be taken apart without anything else moving."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from poise.assembly.contact import WayOut, way_out
from poise.assembly.scene import Assembly
from poise.assembly.statics import Analysis, Deadline, begin_near
from poise.threads import in_one_thread
from poise.types import Array

# Objects looked at before the best order so far is returned.
_TRIES = 20_000
# An object carries another when the normal between them rises by more than this (sine).
_RISE = 0.1


@dataclass(frozen=True)
class Disassembly:
    """An order of removal.

    Args:
        order: ids, the first to take first.
        safe: whether taking each, in this order, moves nothing else, and there is a way out for it.
        margins: N, of what stands afterwards (inf when nothing is left; negative when something falls).
        ways: (3,) for each, a straight way out past all others that are still there; None when none was found.
        complete: every order that might be safe was looked at, or this one is; otherwise the deadline passed before.
        reason: why the first step that is not safe is not: what falls, or what is in its way; empty when all are safe.
    """

    order: tuple[str, ...]
    safe: tuple[bool, ...]
    margins: tuple[float, ...]
    ways: tuple[Array | None, ...]
    complete: bool
    reason: str = ""


@in_one_thread
def plan_disassembly(
    assembly: Assembly | Analysis, target: str | None = None, deadline: float | None = None
) -> Disassembly:
    """Find an order in which each object can be taken while all others stay where they are.

    Whether the rest stands is solved again without the object: the thesis' test (section 4.6.3: the force that lifts
    the object equals its weight) is not the same where objects touch at their sides, since friction there changes
    the force to lift though nothing depends on the object. Objects on which nothing rests are tried first, the highest
    of them first; the first that leaves a standing rest is taken, and dead ends are taken back. What is left settles
    near where it stood before.

    Args:
        assembly: prepared as an `Analysis` when more will be asked.
        target: take this object, and before it only what has to go first: what would fall without it, and what is in
            its way; None: everything.
        deadline: s; then the rest of the order is marked as not safe.

    Raises:
        InputError: OBJECT_UNKNOWN; INTERPENETRATION, FLOATING.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    clock = Deadline.after(deadline)
    analysis = Analysis.of(assembly, deadline=clock)
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
    out: WayOut

    @cached_property
    def margin(self) -> float:
        """N; -inf, too, when the deadline passed before it was known. Nothing stands at 0."""
        found = self.left.stability(self.clock)
        return -np.inf if found.doubtful else found.margin

    @property
    def safe(self) -> bool:
        """The rest stands, and there is a way out."""
        return self.out.direction is not None and self.margin > 0

    def reason(self, before: Analysis) -> str:
        """Why it is not safe; `before`: with the object; empty when it is safe."""
        if self.safe:
            return ""
        if self.clock.passed:
            return f"the deadline passed before it was known whether {self.name} can be taken"
        if self.margin <= 0:
            falling = ", ".join(self.left.stability(self.clock).falling) or "the rest"
            return f"without {self.name}, {falling} would move: hold {falling} while {self.name} is taken"
        blocking = ", ".join(before.assembly.objects[place].id for place in self.out.blocked_by)
        return f"{self.name} has no straight way out" + (f" past {blocking}" if blocking else "")


def _step(analysis: Analysis, name: str, clock: Deadline) -> _Step:
    structure = analysis.structure
    place = analysis.assembly.place_of(name)
    out = way_out(analysis.assembly, structure.interfaces, place, structure.margin, lambda: clock.passed)
    left = analysis.without(name)
    if out.direction is not None:
        begin_near(analysis, left)
    return _Step(name, left, clock, out)


def _steps(analysis: Analysis, clock: Deadline) -> Iterator[_Step]:
    """Safe steps, looked for one by one: first objects that carry nothing, the highest of them first."""
    objects, carrying = analysis.assembly.objects, _carrying(analysis)
    up = -np.asarray(analysis.assembly.gravity)
    items = [objects[place] for place in analysis.structure.movable]
    for item in sorted(items, key=lambda item: (item.id in carrying, -float(item.com_in_world @ up))):
        if clock.passed:
            return
        step = _step(analysis, item.id, clock)
        if step.safe:
            yield step


def _carrying(analysis: Analysis) -> set[str]:
    """Ids of the objects on which others rest."""
    up = -np.asarray(analysis.assembly.gravity)
    objects, interfaces = analysis.assembly.objects, analysis.structure.interfaces
    if not interfaces:
        return set()
    rises = np.array([interface.normal for interface in interfaces]) @ up / (float(np.linalg.norm(up)) or 1.0)
    return {
        objects[interfaces[i].first if rises[i] > 0 else interfaces[i].second].id
        for i in np.flatnonzero(np.abs(rises) > _RISE).tolist()
    }


def _take_apart(analysis: Analysis, clock: Deadline) -> Disassembly:
    """Depth first through the orders in which the rest always stands; sets seen to be dead ends are skipped."""
    dead: set[frozenset[str]] = set()
    path: list[_Step] = []
    best: list[_Step] = []
    choices = [_steps(analysis, clock)]
    tries = 0
    while choices and tries < _TRIES and not clock.passed:
        tries += 1
        left = path[-1].left if path else analysis
        if not left.structure.movable:
            break
        step = next((each for each in choices[-1] if _left_over(each.left) not in dead), None)
        if step is not None:
            path.append(step)
            choices.append(_steps(step.left, clock))
            best = list(path) if len(path) > len(best) else best
        else:
            dead.add(_left_over(left))
            choices.pop()
            if path:
                path.pop()
    rest = best[-1].left if best else analysis
    # Choices end at the deadline, too: then not every order was looked at.
    return _with_rest(rest, best, not (choices or clock.passed) or not rest.structure.movable, clock)


def _left_over(analysis: Analysis) -> frozenset[str]:
    return frozenset(analysis.assembly.objects[place].id for place in analysis.structure.movable)


def _with_rest(rest: Analysis, steps: list[_Step], complete: bool, clock: Deadline) -> Disassembly:
    """An order that goes on, unsafely, through what is left: the highest first. Its first step is looked at."""
    objects = rest.assembly.objects
    names = [objects[place].id for place in sorted(rest.structure.movable, key=lambda p: -objects[p].com_in_world[2])]
    more = [_step(rest, names[0], clock)] if names else []
    unknown = len(names) - len(more)
    return Disassembly(
        (*(step.name for step in steps), *names),
        (True,) * len(steps) + (False,) * len(names),
        (*(step.margin for step in steps + more), *[-np.inf] * unknown),
        (*(step.out.direction for step in steps + more), *[None] * unknown),
        complete,
        more[0].reason(rest) if more else "",
    )


def _free(analysis: Analysis, target: str, clock: Deadline) -> Disassembly:
    """Take what would fall without the target, or is in its way, before it; and so on for what goes before.

    Of what falls without an object, that which rests on nothing but what falls is taken first: the highest. Then all is
    looked at again, so that nothing goes that need not.
    """
    steps: list[_Step] = []
    waiting = [target]
    while waiting and not clock.passed:
        left = steps[-1].left if steps else analysis
        if waiting[-1] not in left.assembly.index:
            waiting.pop()
            continue
        step = _step(left, waiting[-1], clock)
        if step.safe:
            steps.append(step)
            waiting = [target]
            continue
        before = [name for name in _in_the_way(left, step, clock) if name not in waiting]
        if not before:  # each needs the other
            break
        waiting.append(before[0])
    reason = ""
    if target not in [step.name for step in steps]:
        left = steps[-1].left if steps else analysis
        steps.append(_step(left, target, clock))
        reason = steps[-1].reason(left)
    return Disassembly(
        tuple(step.name for step in steps),
        tuple(step.safe for step in steps),
        tuple(step.margin for step in steps),
        tuple(step.out.direction for step in steps),
        not clock.passed,
        reason,
    )


def _in_the_way(left: Analysis, step: _Step, clock: Deadline) -> list[str]:
    """Ids of what has to go before a step, in order: what falls without it, otherwise what is in its way."""
    objects, up = left.assembly.objects, -np.asarray(left.assembly.gravity)
    before = set(step.left.stability(clock).falling) or {objects[place].id for place in step.out.blocked_by}
    carrying = _carrying(left)
    items = [item for item in objects if item.id in before and not item.fixed]
    return [item.id for item in sorted(items, key=lambda item: (item.id in carrying, -float(item.com_in_world @ up)))]
