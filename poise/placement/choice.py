"""Which of several assemblies is taken: the best one whose least robustness elastic contacts confirm."""

from collections.abc import Sequence
from dataclasses import replace

from poise.assembly import Analysis
from poise.assembly.statics import Deadline
from poise.errors import NoAnswerError
from poise.placement.scoring import PlacementScore, confirm_least


def best_confirmed(
    found: Sequence[Analysis], estimates: Sequence[PlacementScore], criterion: str, deadline: Deadline
) -> int:
    """The number of the best of several assemblies.

    Estimates are upper bounds by limit analysis. The best is asked of elastic contacts; if these hold less, another one
    may be the best, and is asked next. One of which a solver
    fails is dropped, but for the last.

    Args:
        found: the assemblies, each with its objects in place.
        estimates: by `estimate_score`.
        criterion: see `PlacementScore.better_than`.
        deadline: when it passes, the best of what is known by then is taken.
    """
    scores, asked, failed = list(estimates), set[int](), set[int]()
    while True:
        left = [number for number in range(len(scores)) if number not in failed] or [0]
        best = left[0]
        for number in left:
            if scores[number].better_than(scores[best], criterion):
                best = number
        if best in asked or len(left) == 1 or deadline.passed:
            return best
        asked.add(best)
        try:
            scores[best] = replace(scores[best], least=confirm_least(found[best], scores[best].least, deadline))
        except NoAnswerError:
            failed.add(best)
