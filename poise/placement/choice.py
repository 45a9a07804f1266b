"""Which of several assemblies is taken: the best one whose least robustness elastic contacts confirm."""

from collections.abc import Sequence
from dataclasses import replace

from poise.assembly import Analysis
from poise.assembly.statics import Deadline
from poise.placement.scoring import PlacementScore, confirm_least


def best_confirmed(
    found: Sequence[Analysis], estimates: Sequence[PlacementScore], criterion: str, deadline: Deadline
) -> int:
    """The number of the best of several assemblies.

    Estimates are upper bounds by limit analysis. The best is asked of elastic contacts; if these hold less, another one
    may be the best, and is asked next.

    Args:
        found: the assemblies, each with its objects in place.
        estimates: by `estimate_score`.
        criterion: see `PlacementScore.better_than`.
        deadline: when it passes, the best of what is known by then is taken.
    """
    scores, asked = list(estimates), set[int]()
    while True:
        best = 0
        for number, score in enumerate(scores):
            if score.better_than(scores[best], criterion):
                best = number
        if best in asked or len(scores) == 1 or deadline.passed:
            return best
        asked.add(best)
        scores[best] = replace(scores[best], least=confirm_least(found[best], scores[best].least, deadline))
