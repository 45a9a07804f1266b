"""Compensation: the wrench of a recording without the effects of a model.

The response of an effect depends on the load, which is unknown. The load is identified from the compensated wrench and
the effects are computed for this load, in turn; the iteration converges because effects are small corrections.
"""

from dataclasses import dataclass, replace

import numpy as np

from poise.mismatch.reading import NominalModel, absent, effect_of, identified, read_recording, with_model_effects
from poise.mismatch.recorded import load_wrench
from poise.recording import Recording, WrenchStream
from poise.types import Array

_ROUNDS = 15
_SETTLED = 1e-7
"""Change of the payload (kg, kg m, kg m2) at which the iteration ends."""


@dataclass(frozen=True, eq=False)
class CompensatedWrench:
    """A compensated wrench.

    Args:
        wrench: the compensated samples; others are absent.
        names: of the compensated effects.
        left: effects that were not compensated, and why.
        size: (6,) rms of the compensation, N and N m.
        notes: sentences on losses and corrections of the reading.
    """

    wrench: WrenchStream
    names: tuple[str, ...]
    left: dict[str, str]
    size: Array
    notes: tuple[str, ...]


def compensate(recording: Recording, model: NominalModel) -> CompensatedWrench:
    """Compensate the wrench of a recording for the effects of a model.

    Events belong to their recording and `payload_parameters` is the load itself: both are not compensated.

    Args:
        recording: with any load, in the hand of the model.
        model: with effects; its payload does not matter.

    Raises:
        InputError: as `read_recording` and `with_model_effects`.
    """
    reading = read_recording(recording, replace(model, phi=None, effects=()))
    recorded = reading.recorded
    chosen, left = [], {}
    for component in model.effects:
        effect = effect_of(component)
        reason = absent(effect, recorded, events=False, values=component.values)
        if effect.widens == "payload":
            reason = "it is the payload itself"
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
