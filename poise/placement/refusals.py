"""Why there is no placement: the counts of rejected poses, and the cause that a program can read."""

from collections import Counter
from collections.abc import Mapping

from poise.assembly import RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.placement.orientation import TURNED
from poise.placement.validation import APART, FALLS, OVERLAPS, ROLLS, SENSITIVE, UNDECIDED

NO_FIT = "no pose fits the places"
_STAGES = {
    TURNED: "orientation",
    NO_FIT: "no_support",
    OVERLAPS: "no_room",
    APART: "no_support",
    UNDECIDED: "undecided",
    FALLS: "not_stable",
    ROLLS: "would_roll",
    SENSITIVE: "not_robust",
}
"""Tests of a pose in their order, and the cause when no pose gets farther."""
_NAMED = {
    "leaves no room for the hand": "no_room_for_hand",
    "out of the arm's reach": "out_of_reach",
    "tips easily": "would_tip",
}


def no_placement(item: RigidObject, rejected: Counter[str], iterations: int, late: bool = False) -> NoAnswerError:
    """NO_PLACEMENT with how many poses each test rejected; DEADLINE when there was no time for a single pose.

    `late`: time was over before all attempts were made.

    The `cause` is that of `cause_of`.
    """
    if not iterations:
        return NoAnswerError(
            ErrorCode.DEADLINE, f"no time was left to try a single pose of {item.id}; give a longer deadline"
        )
    counts = dict(rejected.most_common())
    why = ", ".join(f"{count} {name}" for name, count in counts.items())
    until, more = (" until the deadline", "time") if late else ("", "attempts")
    return NoAnswerError(
        ErrorCode.NO_PLACEMENT,
        f"no place found for {item.id} in {iterations} poses{until} ({why}); make room, or allow more {more}",
        rejected=counts,
        iterations=iterations,
        late=late,
        cause=cause_of(counts),
    )


def cause_of(counts: Mapping[str, int]) -> str:
    """The cause for a program: the test that rejected the poses which passed most tests.

    Args:
        counts: of rejected poses, by test, see `Validator`.
    """
    stages = list(_STAGES)
    last = max(counts, key=lambda name: stages.index(name) if name in stages else len(stages), default=NO_FIT)
    return _STAGES.get(last) or _NAMED.get(last, "condition_not_met")
