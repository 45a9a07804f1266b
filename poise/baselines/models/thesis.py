"""Model `thesis`: slipping by a maximum flow, toppling by Algorithm 2 (chapter 4), the weaker of both (eq. 4.18)."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from poise.assembly import Analysis
from poise.assembly.contact import Structure
from poise.assembly.robustness import LimitLoads, PlainMovement, RobustnessModel
from poise.assembly.statics import NO_DEADLINE, Deadline, Loads
from poise.baselines.robustness import (
    SampledContacts,
    Slipping,
    TopplingAxes,
    cuts,
    sampled_contacts,
    single_pushes,
    topple,
    toppling_axes,
)
from poise.types import Array

# Pushes whose contact conditions are worked out at once.
_BATCH = 256


def thesis(analysis: Analysis, loads: Loads, deadline: Deadline) -> LimitLoads:
    """Robustness as in chapter 4 of the thesis.

    Its own error: contact forces at rest decide, so that what the push itself adds to them is missed where friction
    and normal forces couple, and 20 sampled points move edges inwards (4-7 %). Blocks of a wall have exponentially
    many cuts: past `toppling.MOST_CUTS` the answer is not complete.

    Raises:
        InputError: BAD_INPUT for several forces at once.
        NoAnswerError: UNSTABLE, SOLVER_FAILED.
    """
    loads = single_pushes(loads, "thesis")
    structure = analysis.structure
    model = ThesisAnalysis(structure)
    limit_loads = LimitLoads.start(loads.count)
    movable = np.flatnonzero(np.isin(loads.place, structure.movable))
    _slip(limit_loads, model, loads, movable, deadline)
    for axes in model.axes_until(deadline):
        if axes is None:
            limit_loads.give_up(movable)
            break
        topple(limit_loads, structure, axes, loads, movable[np.isin(loads.place[movable], list(axes.moving))])
    return limit_loads


@dataclass(frozen=True, eq=False)
class ThesisAnalysis:
    """An assembly as chapter 4 sees it: contact forces at rest, the flow network, and the axes of all feasible cuts."""

    structure: Structure

    @cached_property
    def contacts(self) -> SampledContacts:
        return sampled_contacts(self.structure)

    @cached_property
    def slipping(self) -> Slipping:
        return Slipping(self.structure, self.contacts)

    def axes_until(self, deadline: Deadline = NO_DEADLINE) -> "list[TopplingAxes | None]":
        """The toppling axes of each feasible cut; None at the end when there were too many, or no time."""
        found: list[TopplingAxes | None] = []
        for moving in cuts(self.structure):
            if moving is None or deadline.passed:
                return [*found, None]
            axes = toppling_axes(self.contacts, moving)
            if axes is not None:
                found.append(axes)
        return found

    def toppling_improvement(self, place: int, wrench: Array, force: float = 0.0) -> float:
        """RI of toppling, over all axes of cuts that move an object (thesis eq. 4.43), (N m)2 per N.

        Args:
            place: of the object pushed.
            wrench: (6,) of the push of 1 N, about the world's origin.
            force: that is there already, N.
        """
        total = 0.0
        for axes in self.axes_until():
            if axes is not None and place in axes.moving:
                pushing = axes.pushing(wrench[None])[0]
                feasible = np.isfinite(axes.torques)
                total += float((2 * (force * pushing**2 - axes.torques * pushing))[feasible].sum())
        return total


def _slip(
    limit_loads: LimitLoads, model: ThesisAnalysis, loads: Loads, rows: NDArray[np.int64], deadline: Deadline
) -> None:
    for start in range(0, len(rows), _BATCH):
        batch = rows[start : start + _BATCH]
        directions = loads.wrench[batch, :3]
        for row, direction, first, second in zip(
            batch.tolist(), directions, *model.slipping.capacities(directions), strict=True
        ):
            if deadline.passed:
                limit_loads.give_up(rows[rows >= row])
                return
            value, moving = model.slipping.robustness(int(loads.place[row]), first, second)
            if np.isfinite(value):
                motion = np.append(direction, np.zeros(3))
                limit_loads.limit_by(row, value, value, PlainMovement(dict.fromkeys(moving, motion), "slip"))


entry = RobustnessModel(
    "thesis",
    "contact forces at rest decide; slipping by a maximum flow, toppling by Algorithm 2 (thesis chapter 4)",
    thesis,
    several_forces=False,
)
