"""An effect that changed from one recording to another: in which it is, and by how much."""

import math
from dataclasses import dataclass, replace
from typing import Literal

from poise.mismatch.answer import NamedEffect, Quantity
from poise.mismatch.recorded import RecordedMotion

Recorded = Literal["a", "b"]
Side = Literal["a", "b", "both"]

_REST = 0.1
"""Share of an effect that may be left where it is gone."""
_SURE = 3.0
"""Sigmas from which a value is there."""
_OTHER: dict[Recorded, Recorded] = {"a": "b", "b": "a"}


@dataclass(frozen=True, eq=False)
class Change:
    """An effect that changed from A to B.

    Args:
        finding: the effect, with its values as B minus A where `sign` is 1, as A minus B where it is -1.
        sign: see `finding`.
        present_in: the recording that has the effect, or both with other values.
        more_in: the recording with more of it.
        before: its parameters in A, where A has it, too.
    """

    finding: NamedEffect
    sign: int
    present_in: Side
    more_in: Recorded
    before: dict[str, Quantity]

    @property
    def change(self) -> dict[str, Quantity]:
        """Each parameter in B minus that in A."""
        return {n: replace(q, value=self.sign * q.value) for n, q in self.finding.parameters.items()}

    @property
    def sentence(self) -> str:
        """For people."""
        name, lacking = self.finding.effect.name, {"a": "B", "b": "A"}
        if self.present_in == "both":
            return f"{name}: both recordings have it, and {self.more_in.upper()} has more."
        return f"{name}: recording {self.present_in.upper()} has it, and {lacking[self.present_in]} does not."


def change_of(finding: NamedEffect, side: Recorded, own: dict[str, Quantity], other: RecordedMotion) -> Change:
    """The change that a finding is.

    Args:
        finding: what recording `side` has beyond the other one.
        side: see there.
        own: the effect's parameters in the other one; empty where it does not show the effect.
        other: the other recording.
    """
    sign, delta = (1 if side == "b" else -1), finding.parameters
    parameters = [p for p in finding.effect.parameters(other) if p.linear and p.name in delta]
    bounded = [p.name for p in parameters if p.positive or p.name == "mass"]
    # What has one sign is less where its values are negative.
    less = sum(delta[name].value / max(delta[name].std, 1e-12) for name in bounded) < 0.0
    more_in = _OTHER[side] if less else side
    if not own:
        return Change(finding, sign, more_in, more_in, {})
    total = {
        n: Quantity(q.value + delta[n].value, math.hypot(q.std, delta[n].std), q.unit)
        for n, q in own.items()
        if n in delta
    }
    linear = [p.name for p in parameters if p.name in total]
    gone = all(abs(total[n].value) < max(_SURE * total[n].std, _REST * abs(own[n].value)) for n in linear)
    if linear and gone:
        return Change(finding, sign, _OTHER[side], _OTHER[side], own if side == "b" else {})
    return Change(finding, sign, "both", more_in, own if side == "b" else total)


def beyond_errors(change: Change, own: dict[str, Quantity], other: RecordedMotion) -> bool:
    """Whether a change is more than the errors of both answers, and more than a small part of what the other one has.

    Args:
        change: of an effect. own: its parameters in the other recording. other: see `change_of`.
    """
    delta = change.finding.parameters
    linear = [p.name for p in change.finding.effect.parameters(other) if p.linear and p.name in delta]
    sizes = [(delta[name], own.get(name, Quantity(0.0, 0.0, ""))) for name in linear]
    return not linear or any(
        abs(q.value) > max(_SURE * math.hypot(q.std, before.std), _REST * abs(before.value)) for q, before in sizes
    )


def alike(one: dict[str, Quantity], other: dict[str, Quantity]) -> bool:
    """Whether two recordings by themselves show the same of an effect."""
    return all(
        abs(other[n].value - q.value) < max(_SURE * math.hypot(q.std, other[n].std), _REST * abs(q.value))
        for n, q in one.items()
        if n in other
    )


def as_much(one: dict[str, Quantity], other: dict[str, Quantity]) -> bool:
    """Whether a recording by itself shows as much of an effect as another one, within three sigma of both."""
    return all(
        one[n].value * math.copysign(1.0, q.value) > abs(q.value) - _SURE * math.hypot(q.std, one[n].std)
        for n, q in other.items()
        if n in one
    )
