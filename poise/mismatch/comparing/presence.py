"""Whether one recording by itself shows an effect, and with which values: one fit beside what most arms lack."""

from poise.mismatch.answer import NamedEffect, Quantity, covariances, quantities
from poise.mismatch.effects import Effect, Values, effect_named
from poise.mismatch.inference import WARM_STEPS, FittedEffect, effort_problem, fit, wrench_problem
from poise.mismatch.reading import NominalModel, acting_on_efforts
from poise.mismatch.recorded import RecordedMotion

USUAL = ("coulomb_friction", "viscous_friction", "motor_inertia", "payload_parameters")
"""What most models of arms lack: without these beside it, an effect would explain a part of them."""
_SURE = 3.0
"""Sigmas from which a value is shown."""


def own_values(finding: NamedEffect, recorded: RecordedMotion, model: NominalModel) -> dict[str, Quantity]:
    """The parameters of an effect in one recording; empty where it does not show it.

    Args:
        finding: an effect, with values of its non-linear parameters.
        recorded: the recording.
        model: of it.
    """
    effect = finding.effect
    problem = (effort_problem if effect.signal == "effort" else wrench_problem)(recorded, model)
    usual = (_beside(name, effect, problem.recorded) for name in USUAL if name != effect.name)
    own = {p.name: 0.0 if p.linear else finding.values[p.name] for p in effect.parameters(recorded)}
    parts = [FittedEffect(effect, own), *(part for part in usual if part is not None)]
    found = fit(problem.weighed(), parts, WARM_STEPS)
    inputs = problem.compose(found.parts)[0]
    part, covariance = found.parts[0], covariances(found, inputs)[0]
    values = quantities(part, inputs[0], covariance)
    linear = [p.name for p in effect.parameters(recorded) if p.linear]
    sigma = dict(zip((p.name for p in effect.parameters(inputs[0])), covariance.diagonal() ** 0.5, strict=True))
    shown = any(abs(part.values[name]) > _SURE * max(float(sigma[name]), 1e-12) for name in linear)
    return values if shown or not linear else {}


def _beside(name: str, effect: Effect, recorded: RecordedMotion) -> FittedEffect | None:
    """One of the usual effects on the signal of another one, at zero; None where it has no place beside that."""
    usual = effect_named(name)
    if usual is None or name in effect.made_of:
        return None
    reached = usual
    if usual.signal != effect.signal:
        acting = acting_on_efforts(usual) if effect.signal == "effort" else None
        if acting is None:
            return None
        reached = acting
    if reached.untestable(recorded):
        return None
    values: Values = {
        p.name: 0.0 if p.linear else reached.defaults.get(p.name, p.from_unit(0.5))
        for p in reached.parameters(recorded)
    }
    return FittedEffect(reached, values)
