"""Why there is no placement: the counts of rejected poses, and the cause that a program can read."""

from collections import Counter
from collections.abc import Collection, Mapping

from poise.assembly import RigidObject
from poise.errors import ErrorCode, NoAnswerError
from poise.placement.orientation import TURNED
from poise.placement.validation import APART, ENCLOSED, FALLS, OVERLAPS, ROLLS, SENSITIVE, UNDECIDED

NO_FIT = "no pose fits the places"
NO_ROOM = "no room on a level surface"
_STAGES = {
    TURNED: "orientation",
    NO_FIT: "no_support",
    NO_ROOM: "no_room",
    OVERLAPS: "no_room",
    APART: "no_support",
    UNDECIDED: "undecided",
    FALLS: "not_stable",
    ROLLS: "would_roll",
    ENCLOSED: "no_way_in",
    SENSITIVE: "not_robust",
}
"""Tests of a pose in their order, and the cause when no pose gets farther."""
_NAMED = {
    "leaves no room for the hand": "no_room_for_hand",
    "out of the arm's reach": "out_of_reach",
    "tips easily": "would_tip",
}


def no_placement(
    item: RigidObject, rejected: Counter[str], iterations: int, late: bool = False, looks: Collection[str] = ()
) -> NoAnswerError:
    """NO_PLACEMENT with how many poses each test rejected; DEADLINE when there was no time for a single pose.

    `late`: time was over before all attempts were made.

    The `cause` is that of `cause_of`, and so is `looks`.
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
        cause=cause_of(counts, looks),
    )


def cause_of(counts: Mapping[str, int], looks: Collection[str] = ()) -> str:
    """The cause for a program: the test that rejected the poses which passed most tests.

    Args:
        counts: of rejected poses, by test, see `Validator`.
        looks: names of the conditions on the pose alone, which are tested first.
    """
    stages = [*looks, *(name for name in _STAGES if name not in looks)]
    last = max(counts, key=lambda name: stages.index(name) if name in stages else len(stages), default=NO_FIT)
    return _STAGES.get(last) or _NAMED.get(last, "condition_not_met")
