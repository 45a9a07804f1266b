"""When an effect acts, and whether a search for it has to follow what other effects leave."""

from poise.mismatch.effects import Effect, Values
from poise.mismatch.inference.problem import Problem
from poise.mismatch.recorded import RecordedMotion


def follows_residual(effect: Effect, problem: Problem) -> bool:
    """Whether the starting points of an effect follow a residual: it chooses a joint, or a place and a time."""
    parameters = effect.parameters(problem.recorded)
    chooses = any(p.choice and p.low >= 1.0 for p in parameters)  # joints are numbered from 1
    return chooses or (effect.layer != "friction" and not all(p.linear for p in parameters))


def brief(effect: Effect, recorded: RecordedMotion, start: Values) -> bool:
    """Whether a fast event begins or ends within a recording."""
    begin, end = recorded.seconds[[0, -1]]
    windows = effect.windows(recorded, start) if effect.layer == "event" and effect.fast else ()
    return any(first > begin or last < end for first, last in windows)
