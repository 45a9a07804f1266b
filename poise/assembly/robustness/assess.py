"""How hard may each of these be pushed? The answer of the robustness service and of `poise robustness`."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from poise.assembly.robustness.block_answers import coupled_questions
from poise.assembly.robustness.limit_loads import LimitLoads, Movement
from poise.assembly.robustness.registry import DEFAULT_MODEL, ROBUSTNESS_MODELS
from poise.assembly.scene import Assembly, RigidObject
from poise.assembly.statics import Analysis, Deadline, Loads, Push, loads_of
from poise.notebooks import html_table
from poise.threads import in_one_thread
from poise.types import Array, Mask


@dataclass(frozen=True, eq=False)
class Robustness:
    """How hard one push can be before something moves.

    Args:
        robustness: N; inf when no force along this line moves anything. The factor on all forces, for several.
        lower, upper: N; certified by the model: lower <= truth <= upper.
        checked: elastic contacts with Coulomb friction hold 98 % of it, or lowered it to what they hold.
        doubtful: contact forces have a choice here and elastic contacts did not show what is held: under `default`
            for lack of time, or as they were not followed until they collapse, and then `lower` is what was confirmed;
            other models never ask, and `lower` is their own.
    """

    robustness: float
    lower: float
    upper: float
    checked: bool
    doubtful: bool
    _evidence: "_Evidence" = field(repr=False)

    def __repr__(self) -> str:
        moves = ", ".join(self.moves) or "nothing"
        return f"Robustness({self.robustness:.4g} N in [{self.lower:.4g}, {self.upper:.4g}], {self.mode}: {moves})"

    @property
    def mode(self) -> str:
        """none, slip, topple, roll or mixed."""
        mechanism = self._evidence.mechanism
        return "none" if mechanism is None else mechanism.mode

    @property
    def moves(self) -> tuple[str, ...]:
        """Ids of what moves first."""
        mechanism = self._evidence.mechanism
        if mechanism is None:
            return ()
        return tuple(self._evidence.objects[place].id for place in mechanism.velocities)

    @property
    def mechanism(self) -> Array:
        """(len(moves), 6) velocity of each com, m/s, and angular velocity, rad/s, in the assembly's frame.

        Scaled so that the pushed point moves at 1 m/s along the push.
        """
        return self._evidence.scaled


@dataclass(frozen=True, eq=False)
class _Evidence:
    """Where a robustness comes from; computed when first used."""

    limit_loads: LimitLoads
    loads: Loads
    question: int
    objects: tuple[RigidObject, ...]

    @property
    def mechanism(self) -> Movement | None:
        return self.limit_loads.mechanisms[self.question]

    @cached_property
    def scaled(self) -> Array:
        if self.mechanism is None:
            return np.zeros((0, 6))
        velocities = self.mechanism.velocities
        power = 0.0
        for row in np.flatnonzero(self.loads.question == self.question):
            place = int(self.loads.place[row])
            if place in velocities:
                wrench, velocity = self.loads.wrench[row], velocities[place]
                moment = wrench[3:] - np.cross(self.objects[place].com_in_world, wrench[:3])
                power += float(wrench[:3] @ velocity[:3] + moment @ velocity[3:])
        return np.array(list(velocities.values())).reshape(-1, 6) / (power if abs(power) > 1e-12 else 1.0)


@dataclass(frozen=True, eq=False)
class Assessment:
    """Answers about an assembly.

    Args:
        stable: it stands by itself.
        margin: N by which every interface could press less and still hold; 0 on the verge of moving; negative when
            it falls.
        falling: ids of what falls, or is on the verge of it.
        results: one per push; all 0 when the assembly does not stand.
        complete: the deadline left time for all; otherwise bounds may be 0 and inf.
        doubtful: whether it stands was not checked in time: `stable` is then False, and `margin` at most 0.
    """

    stable: bool
    margin: float
    falling: tuple[str, ...]
    results: tuple[Robustness, ...]
    complete: bool = True
    doubtful: bool = False

    def __repr__(self) -> str:
        state = "stable" if self.stable else f"unstable: {', '.join(self.falling)}"
        return f"Assessment({state}, margin {self.margin:.4g} N, results {list(self.results)})"

    def _repr_html_(self) -> str:
        """Whether it stands, and the answer to each push, for notebooks."""
        state = "stable" if self.stable else f"unstable: {', '.join(self.falling)}"
        rows = [
            (
                number,
                f"{each.robustness:.4g}",
                f"{each.lower:.4g} to {each.upper:.4g}",
                each.mode,
                ", ".join(each.moves),
            )
            for number, each in enumerate(self.results)
        ]
        headings = ("push", "robustness, N", "bounds, N", "mode", "moves first")
        return html_table(f"{state}, margin {self.margin:.4g} N", headings, rows)


@in_one_thread
def assess(
    assembly: Assembly | Analysis,
    pushes: Sequence[Push | Sequence[Push]],
    model: str | None = None,
    deadline: float | None = None,
    tolerance: float | None = None,
) -> Assessment:
    """How hard each push may be before something moves.

    Args:
        assembly: prepared as an `Analysis` when more questions will follow.
        pushes: single ones, or sequences of pushes that grow together.
        model: a name in `ROBUSTNESS_MODELS`; None: default.
        deadline: s; what is certified by then is returned, with `complete` False.
        tolerance: m by which points may be off the surface; None: the margin of contacts.

    Raises:
        InputError: a bad push or model name; UNSUPPORTED for a model that is not installed; INTERPENETRATION, FLOATING.
        NoAnswerError: SOLVER_FAILED.
    """
    clock = Deadline.after(deadline)
    solve = ROBUSTNESS_MODELS.find(model or DEFAULT_MODEL).solve
    analysis = Analysis.of(assembly, deadline=clock)
    loads = loads_of(analysis.assembly, pushes, analysis.structure.margin if tolerance is None else tolerance)
    # In a hurry the pushes go first: whether any contact forces balance is known soon.
    limit_loads = LimitLoads.start(loads.count)
    if not any(block.solvers.balance.margin <= 0 for block in analysis.blocks if not clock.passed):
        limit_loads = solve(analysis, loads, clock)
    found = analysis.stability(clock)
    coupled = coupled_questions(analysis, loads)
    if found.doubtful:
        limit_loads.lower[:] = 0.0
        limit_loads.checked &= ~coupled
    elif not found.stable:
        limit_loads = LimitLoads.start(loads.count)
        limit_loads.lower[:] = limit_loads.upper[:] = 0.0
        coupled[:] = False
    results = robustness(limit_loads, loads, analysis.assembly.objects, coupled & ~limit_loads.checked)
    complete = limit_loads.complete and not found.doubtful
    return Assessment(found.stable, found.margin, found.falling, results, complete, found.doubtful)


def robustness(
    limit_loads: LimitLoads, loads: Loads, objects: tuple[RigidObject, ...], doubtful: Mask
) -> tuple[Robustness, ...]:
    """Results of a model, one per question; some (Q,) doubtful."""
    # Where elastic contacts hold less than limit analysis allows, or time ran out, the lower bound is what is known.
    lowered = limit_loads.lower < 0.999 * limit_loads.upper
    values = np.where(lowered, limit_loads.lower, limit_loads.upper)
    rows = zip(
        values.tolist(),
        limit_loads.lower.tolist(),
        limit_loads.upper.tolist(),
        limit_loads.checked.tolist(),
        doubtful.tolist(),
        strict=True,
    )
    return tuple(
        Robustness(value, min(lower, upper), upper, checked, doubt, _Evidence(limit_loads, loads, question, objects))
        for question, (value, lower, upper, checked, doubt) in enumerate(rows)
    )
