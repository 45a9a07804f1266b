"""A recording without the effects that a model knows: what the sensor would have read had they not been there.

What an effect does to the wrench depends on the load, which is what is asked for: it is identified from the wrench
without the effects, these are computed anew for it, and so on; each round changes less, for effects are corrections.
"""

from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.reading import NominalModel, absent, effect_of, identified, read_recording, with_model_effects
from poise.mismatch.recorded import load_wrench
from poise.recording import Recording, WrenchStream
from poise.types import Array

_ROUNDS = 15
_SETTLED = 1e-7
"""Change of the payload (kg, kg m, kg m2) below which the rounds end."""


@dataclass(frozen=True, eq=False)
class CompensatedWrench:
    """A wrench without known effects.

    Args:
        wrench: the corrected samples; what could not be corrected is absent.
        names: of the effects that were taken out.
        left: those that were not, and why.
        size: (6,) rms of what was taken out, N and N m.
        notes: what there is to say about how the recording was read.
    """

    wrench: WrenchStream
    names: tuple[str, ...]
    left: dict[str, str]
    size: Array
    notes: tuple[str, ...]


def compensate(recording: Recording, model: NominalModel) -> CompensatedWrench:
    """Take a model's effects out of the wrench of a recording.

    Events belong to the recording that they were found in and `payload_parameters` is the load itself: they stay.

    Args:
        recording: of any load, in the hand that the model was found with.
        model: with effects; its payload does not matter.

    Raises:
        InputError: as `read_recording` and `with_model_effects`.
    """
    reading = read_recording(recording, replace(model, phi=None, effects=()))
    recorded = reading.recorded
    chosen, left = [], {}
    for component in model.effects:
        effect = effect_of(component)
        reason = absent(effect, recorded, events=False)
        if effect.widens == "payload":
            reason = "it is the payload, which is asked for"
        if effect.signal != "wrench":
            reason = "it acts on joint efforts"
        if reason:
            left[component.name] = reason
        else:
            chosen.append(component)
    phi, response = recorded.phi, np.zeros((len(recorded), 6))
    for _ in range(_ROUNDS if chosen else 0):
        nominal = load_wrench(phi, recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)
        here = replace(recorded, phi=phi, prediction=nominal)
        response = with_model_effects(here, chosen).prediction - nominal
        before, phi = phi, identified(replace(recorded, wrench=recorded.wrench - response))
        if float(np.abs(phi - before).max()) < _SETTLED:
            break
    stamps = recorded.start + np.round(recorded.seconds * 1e9).astype(np.int64)
    frame = reading.model.sensor_frame or "ft_sensor"
    return CompensatedWrench(
        WrenchStream(stamps, recorded.wrench - response, frame),
        tuple(component.name for component in chosen),
        left,
        np.sqrt(np.mean(response**2, axis=0)),
        reading.notes,
    )
