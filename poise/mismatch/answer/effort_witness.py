"""Joint efforts as a witness: they can distinguish effects with equal wrenches.

A tilted base turns gravity for the arm as well, a pull on the tool does not; a sensor that is turned or scaled does not
act on the joints at all.
"""

from collections.abc import Sequence
from dataclasses import replace

from poise.mismatch.answer.named import NamedEffect
from poise.mismatch.answer.signal_diagnosis import SignalDiagnosis
from poise.mismatch.effects import Effect
from poise.mismatch.inference import WARM_STEPS, FittedEffect, Problem, effort_problem, fit, residual_of
from poise.mismatch.reading import (
    LoadOnEfforts,
    ModelEffect,
    NominalModel,
    acting_on_efforts,
    effect_of,
    with_model_effects,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Mask

_CONTRADICTED = 12.0
"""log evidence of both signals by which another effect must exceed a name."""


def contradicted(
    recorded: RecordedMotion,
    model: NominalModel,
    found: Sequence[NamedEffect],
    efforts: SignalDiagnosis,
    seen: Mask | None = None,
) -> frozenset[str]:
    """Names of the wrench in whose place another effect explains wrench and efforts together better.

    Args:
        recorded: with joint efforts.
        model: its tolerances hold for each explanation.
        found: named effects of the wrench.
        efforts: examined beside these names. Its new physics of the joints stays; errors beyond the tolerances do not,
            since they may have followed a wrong name.
        seen: (M,) samples of the efforts that count; None: all.
    """
    track = efforts.problem.recorded.effort
    if track is not None and recorded.effort is not None:
        recorded = replace(recorded, effort=replace(recorded.effort, stuck=track.stuck))
    joints = [part for part in efforts.best.parts if part.effect.layer == "friction" and not part.effect.widens]
    out = set()
    for each in found:
        others = _other_ways(each)
        if not others:
            continue
        beside = [other.component for other in found if other is not each]
        named = replace(effort_problem(_acting(recorded, [*beside, each.component]), model), judged=seen)
        least = _evidence(named, joints) + _CONTRADICTED
        for other, lack in others:
            instead = effort_problem(_acting(recorded, [*beside, other]), model)
            if _evidence(replace(instead, band=named.band, judged=seen), joints) - lack > least:
                out.add(each.effect.name)
                break
    return frozenset(out)


def _other_ways(found: NamedEffect) -> list[tuple[ModelEffect, float]]:
    """The nearest alternative of each other way to act on the joints: equal wrenches on the load load them equally."""
    ways: dict[str, tuple[ModelEffect, float]] = {}
    for other, lack in sorted(found.alternatives, key=lambda pair: pair[1], reverse=True):
        ways[_way(effect_of(other))] = other, lack
    ways.pop(_way(found.effect), None)
    return list(ways.values())


def _way(effect: Effect) -> str:
    """How an effect acts on the joints: not at all, as a wrench on the load, or as its own."""
    if effect.layer == "sensor":
        return ""
    return "load" if isinstance(acting_on_efforts(effect), LoadOnEfforts) else effect.name


def _acting(recorded: RecordedMotion, components: Sequence[ModelEffect]) -> RecordedMotion:
    """The recording with the efforts that these effects need; those of the sensor need none."""
    reached = [each for each in components if effect_of(each).layer != "sensor"]
    return with_model_effects(recorded, reached, events=True)


def _evidence(problem: Problem, joints: Sequence[FittedEffect]) -> float:
    """Of the efforts with these effects, under the noise that they leave."""
    rough = fit(problem.weighed(), joints, WARM_STEPS)
    settled = problem.with_noise(problem.fitted_noise(residual_of(problem, rough)))
    return fit(settled, rough.parts, 0).log_evidence
