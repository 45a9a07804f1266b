"""What a diagnosis says of the joints and the payload, as values that simulators and robot descriptions have."""

from collections.abc import Iterable, Mapping
from typing import Any

import numpy as np

from poise.errors import ErrorCode, NoAnswerError
from poise.inertia.model import InertialParameters
from poise.mismatch.answer import Diagnosis
from poise.mismatch.application.known_load import known_load
from poise.mismatch.effects import effect_named, numbered_joints
from poise.mismatch.reading import ModelEffect

_PAYLOAD = "payload_parameters"
_LIKELY = 0.5
"""Probability from which a finding changes a model."""
_OF_SENSORS = {"sensor_rotation", "saturation", "clock_offset"}
_NO_LIMIT = 1e4
"""N and N m from which a sensor does not saturate."""
_LOST = {"stribeck_friction": "the stiction at low speed", "coulomb_friction": "the asymmetry and width"}


def joint_values(found: Diagnosis) -> dict[str, dict[str, float]]:
    """Friction, N m, damping, N m s/rad, and armature, kg m2, of joints by name; for slides N, N s/m and kg.

    Those of the nominal model and of the likely findings, added.
    """
    recorded = found.main.problem.recorded
    joints = numbered_joints(recorded)
    values: dict[str, dict[str, float]] = {}
    for effect in _effects(found):
        for parameter, value in effect.values.items():
            name, _, number = parameter.rpartition("_")
            kind = _of_joint(effect).get(name)
            if kind is not None:
                of_joint = values.setdefault(joints[int(number)], {})
                of_joint[kind] = of_joint.get(kind, 0.0) + value
    stated = () if recorded.effort is None else zip(recorded.effort.names, recorded.effort.stated, strict=False)
    for joint, physics in stated:
        for kind in values.get(joint, {}):
            values[joint][kind] = max(values[joint][kind] + getattr(physics, kind), 0.0)
    return values


def found_payload(found: Diagnosis) -> InertialParameters | None:
    """The payload in the sensor frame; None when no likely finding changes it.

    Where no body has the inertia that was found, because the motion does not show it, that of the nominal payload about
    its centre of mass is scaled by the mass.

    Raises:
        InputError: as `known_load`.
        NoAnswerError: NOT_CONSISTENT for a mass that is not positive.
    """
    if all(effect.name != _PAYLOAD for effect in _effects(found)):
        return None
    load = InertialParameters.from_phi(known_load(found.augmented)[0])
    if load.mass <= 0.0:
        raise NoAnswerError(ErrorCode.NOT_CONSISTENT, f"no model has a payload of {load.mass:.3f} kg")
    if load.is_consistent:
        return load
    nominal = InertialParameters.from_phi(found.main.problem.recorded.phi)
    inertia = nominal.inertia * load.mass / nominal.mass if nominal.mass > 0.0 else np.zeros((3, 3))
    return InertialParameters(load.mass, load.com, inertia)


def found_sensor(found: Diagnosis) -> dict[str, Any]:
    """What the wrench shows of its sensor: the fields of a `SensorChange` but the frame; empty without a wrench.

    The noise is that of the recording; rotation, saturation and lateness are those of likely findings.
    """
    examined = next((each for each in found.examinations if each.problem.signal == "wrench"), None)
    if examined is None:
        return {}
    values: dict[str, Any] = {}
    for name, channels in (("force_noise", slice(0, 3)), ("torque_noise", slice(3, 6))):
        values[name] = float(np.sqrt(np.mean(examined.problem.noise.sigma[channels] ** 2)))
    for effect in _effects(found):
        if effect.name == "sensor_rotation":
            values["turn"] = np.array([effect.values[f"rotation_{axis}"] for axis in "xyz"])
        elif effect.name == "saturation":
            limits = {f"{name}_limit": effect.values[f"{name}_limit"] for name in ("force", "torque")}
            values |= {name: limit for name, limit in limits.items() if limit < _NO_LIMIT}
        elif effect.name == "clock_offset":
            values["delay"] = effect.values["offset"]
    return values


def without_place(found: Diagnosis) -> list[str]:
    """What of the answer is neither a value of a joint nor the payload, or is too uncertain, as clauses."""
    clauses = [
        f"{each.effect.name}, whose probability is {each.belief.probability:.0%}"
        for each in found.findings
        if each.belief.probability < _LIKELY
    ]
    for effect in _effects(found):
        if effect.name in _LOST:
            clauses.append(f"{_LOST[effect.name]} of {effect.name}")
        elif not _of_joint(effect) and effect.name not in (_PAYLOAD, *_OF_SENSORS):
            clauses.append(f"{effect.name}, which is no value of a joint or of the payload")
    return clauses


def _of_joint(component: ModelEffect) -> Mapping[str, str]:
    """The parameters that are values of one joint, and what `JointPhysics` calls them."""
    effect = effect_named(component.name)
    return {} if effect is None else effect.of_joint


def _effects(found: Diagnosis) -> Iterable[ModelEffect]:
    likely = [each.component for each in found.findings if each.belief.probability >= _LIKELY]
    return (*found.main.problem.model.effects, *likely)
