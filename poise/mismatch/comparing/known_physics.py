"""What a diagnosis found in one recording, as what the model of another one has already and may have too much of."""

from dataclasses import replace

import numpy as np

from poise.mismatch.answer import Diagnosis
from poise.mismatch.effects import PAYLOAD_PARAMETERS, numbered_joints
from poise.mismatch.recorded import RecordedMotion
from poise.simulation.models import JointPhysics


def with_known_physics(recorded: RecordedMotion, found: Diagnosis) -> RecordedMotion:
    """The recording whose model has the friction, rotors and load that a diagnosis found: it may have less of them.

    Their efforts are not added to the prediction: `with_model_effects` does that.
    """
    loads = [each for each in found.findings if each.effect.name == "payload_parameters"]
    phi = recorded.phi + sum(np.array([each.values[name] for name in PAYLOAD_PARAMETERS]) for each in loads)
    recorded = replace(recorded, phi=phi)
    effort = recorded.effort
    if effort is None:
        return recorded
    numbers = {joint: number for number, joint in numbered_joints(recorded).items()}
    stated = effort.stated or (JointPhysics(),) * len(effort.names)
    known = []
    for name, physics in zip(effort.names, stated, strict=True):
        added = {each: getattr(physics, each) for each in ("friction", "damping", "armature")}
        for finding in found.findings:
            for stem, what in finding.effect.of_joint.items():
                added[what] += finding.values.get(f"{stem}_{numbers[name]}", 0.0)
        known.append(replace(physics, **added))
    return replace(recorded, effort=replace(effort, stated=tuple(known)))
