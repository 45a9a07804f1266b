"""The effects of a model, applied to a recording by the `simulate` that found them."""

from collections.abc import Sequence
from dataclasses import replace

from poise.errors import ErrorCode, InputError
from poise.mismatch.effects import LAYERS, Effect, Values, effect_named, numbered_joints
from poise.mismatch.reading.load_on_efforts import acting_on_efforts
from poise.mismatch.reading.nominal_model import ModelEffect
from poise.mismatch.recorded import RecordedMotion
from poise.simulation.models import JointPhysics


def with_model_effects(
    recorded: RecordedMotion, components: Sequence[ModelEffect], *, events: bool = False
) -> RecordedMotion:
    """The recording with the effects of a model added to its predictions, layer by layer.

    An effect whose inputs are missing (joint efforts, a base that moves) is left out.

    Args:
        recorded: a recording, or a simulated motion.
        components: of a model.
        events: whether effects that belong to one recording (a contact, a dropped part) happen here too, at the
            seconds that the model says.

    Raises:
        InputError: BAD_INPUT for an effect that is not in the library, or that lacks a parameter.
    """
    known = [(effect_of(component), component) for component in components]
    for effect, component in sorted(known, key=lambda pair: (LAYERS.index(pair[0].layer), pair[0].order, pair[0].name)):
        if absent(effect, recorded, events, component.values):
            continue
        values = complete_values(effect, recorded, component.values)
        reached = acting_on_efforts(effect)
        for acting in (effect,) if reached is None or reached.untestable(recorded) else (effect, reached):
            response = acting.simulate(recorded, values)
            if acting.signal == "wrench":
                recorded = recorded.with_prediction(recorded.prediction + response)
            elif recorded.effort is not None:
                recorded = recorded.with_effort(recorded.effort.prediction + response)
    return recorded


def with_joint_physics(recorded: RecordedMotion, components: Sequence[ModelEffect]) -> RecordedMotion:
    """The recording that knows which friction, damping and rotors the effects of a model give its joints.

    It may have less of them, and the reversals of their friction are not known. Efforts are not predicted again:
    `with_model_effects` does that.
    """
    effort = recorded.effort
    if effort is None:
        return recorded
    numbers = {joint: number for number, joint in numbered_joints(recorded).items()}
    stated = []
    for name, physics in zip(effort.names, effort.stated or (JointPhysics(),) * len(effort.names), strict=True):
        added = {each: getattr(physics, each) for each in ("friction", "damping", "armature")}
        ramps = [physics.ramp]
        for component in components:
            for stem, what in effect_of(component).of_joint.items():
                added[what] += component.values.get(f"{stem}_{numbers[name]}", 0.0)
            ramps += [component.values.get(key, 0.0) for key in ("transition", f"ramp_{numbers[name]}")]
        stated.append(replace(physics, **added, ramp=max(ramps)))
    return replace(recorded, effort=replace(effort, stated=tuple(stated)))


def complete_values(effect: Effect, recorded: RecordedMotion, values: Values) -> Values:
    """The values of a model's effect, with its defaults for those that the model leaves out.

    Raises:
        InputError: BAD_INPUT when a value without a default is left out.
    """
    complete, lacking = _completed(effect, recorded, values)
    if lacking:
        raise InputError(ErrorCode.BAD_INPUT, f"effect {effect.name} of the model lacks {', '.join(lacking)}")
    return complete


def _completed(effect: Effect, recorded: RecordedMotion, values: Values) -> tuple[Values, list[str]]:
    """The values with the defaults, and the names of those that are still missing."""
    parameters = [p.name for p in effect.parameters(recorded)]
    # Names of defaults may leave out the joint: "asymmetry" is that of every joint.
    usual = {name: effect.defaults[stem] for name in parameters for stem in effect.defaults if name.startswith(stem)}
    complete = {**usual, **effect.renewed(values)}
    return complete, [name for name in parameters if name not in complete]


def effect_of(component: ModelEffect) -> Effect:
    """The effect that a component names.

    Raises:
        InputError: BAD_INPUT when the library has none of that name.
    """
    effect = effect_named(component.name)
    if effect is None:
        raise InputError(ErrorCode.BAD_INPUT, f"the model has an effect '{component.name}' that is not in the library")
    return effect


def absent(effect: Effect, recorded: RecordedMotion, events: bool, values: Values) -> str:
    """Why an effect of a model, with its values, does not act in a recording; "" when it does."""
    if not events and not effect.transfers:
        return "it belongs to the recording that it was found in"
    if effect.signal == "effort" and recorded.effort is None:
        return "there are no joint efforts"
    if not effect.transfers and _completed(effect, recorded, values)[1]:
        return "its values need what only its own recording has, such as an accelerometer"
    return effect.untestable(recorded)
