"""Joint efforts as a witness: they can distinguish effects with equal wrenches.

A tilted base turns gravity for the arm as well, a pull on the tool does not; a sensor that is turned or scaled does not
act on the joints at all.
"""

from collections.abc import Sequence
from dataclasses import replace

from poise.mismatch.answer.named import NamedEffect
from poise.mismatch.effects import effect_named
from poise.mismatch.inference import Problem, effort_problem, fit, residual_of
from poise.mismatch.reading import ModelEffect, NominalModel, with_model_effects
from poise.mismatch.recorded import RecordedMotion

_CONTRADICTED = 12.0
"""log evidence of both signals by which another effect must exceed a name."""


def contradicted(recorded: RecordedMotion, model: NominalModel, found: Sequence[NamedEffect]) -> frozenset[str]:
    """Names of the wrench in whose place another effect explains wrench and efforts together better.

    Args:
        recorded: with joint efforts.
        model: its tolerances hold for each explanation.
        found: named effects of the wrench.
    """
    out = set()
    for each in (each for each in found if each.alternatives):
        beside = [other.component for other in found if other is not each]
        named = effort_problem(_acting(recorded, [*beside, each.component]), model)
        least = _evidence(named) + _CONTRADICTED
        for other, lack in each.alternatives:
            instead = effort_problem(_acting(recorded, [*beside, other]), model)
            if _evidence(replace(instead, band=named.band)) - lack > least:
                out.add(each.effect.name)
                break
    return frozenset(out)


def _acting(recorded: RecordedMotion, components: Sequence[ModelEffect]) -> RecordedMotion:
    """The recording with the efforts that these effects need; those of the sensor need none."""
    effects = [(each, effect_named(each.name)) for each in components]
    reached = [each for each, effect in effects if effect is not None and effect.layer != "sensor"]
    return with_model_effects(recorded, reached, events=True)


def _evidence(problem: Problem) -> float:
    """Of the efforts without other effects, under the noise that the calibration errors leave."""
    rough = fit(problem, ())
    return fit(problem.with_noise(problem.fitted_noise(residual_of(problem, rough))), ()).log_evidence
