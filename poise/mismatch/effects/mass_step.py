"""Mass step: at one moment the payload changes, as when a part is dropped or picked up."""

from collections.abc import Iterable

import numpy as np

from poise.inertia.model import regressor
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.payload_parameters import FARTHEST_CENTRE
from poise.mismatch.effects.starts import steps
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_ROWS = ("mass", "moment_x", "moment_y", "moment_z")

_BESIDE = 0.5
"""s that a recording must show before and after the change; the first 0.4 s are not compared."""


class MassStep(Effect):
    """phi(t) = phi + dphi for t >= time; a small part: its inertia about its own centre is left out."""

    name = "mass_step"
    layer = "event"
    equation = "w = A(t) (phi + dphi [t >= time]), dphi = (dm, dm c)"
    source = "thesis eq. 2.97 with a payload that changes once"
    excited_by = "gravity; the time is resolved to a sample"
    separating_motion = "turn the tool after the change: weight turns with gravity, a bias does not"
    confused_with = ("mass_leak", "contact", "sensor_bias", "bias_drift")
    transfers = False

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return (
            EffectParameter(
                "time",
                "s",
                low=float(recorded.seconds[0]),
                high=float(recorded.seconds[-1]),
                linear=False,
                resolution=recorded.period,
            ),
            EffectParameter("mass", "kg", 0.3),
            *(EffectParameter(name, "kg m", 0.03) for name in _ROWS[1:]),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        for time in steps(recorded, residual, self.columns(recorded, {"time": -np.inf})):
            yield {"time": time}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        after = (recorded.seconds >= nonlinear["time"]) & recorded.recording_of(nonlinear["time"])
        matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)[:, :, :4]
        return np.asarray(matrix * after[:, None, None])

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        return ((values["time"], float(recorded.seconds[recorded.recording_of(values["time"])][-1])),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        del recorded
        mass = values["mass"] or 1e-9
        return {axis: (values[f"moment_{axis}"] / mass, "m") for axis in "xyz"}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """The first moment changes by at most the reach of the payload times the mass that is there or comes.

        A change at an end of a single recording is none: nothing shows the payload before it or after it.
        """
        if not recorded.begins and not _BESIDE < values["time"] - recorded.seconds[0] < recorded.duration - _BESIDE:
            return "the payload would change at the end or the start of the recording"
        moment = np.linalg.norm([values[name] for name in _ROWS[1:]])
        mass = max(float(recorded.phi[0]), 0.5) + abs(values["mass"])
        return "the mass that changes would lie outside the payload" if moment > FARTHEST_CENTRE * mass else ""

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        change = "heavier" if values["mass"] > 0 else "lighter"
        return (
            f"At {values['time']:.2f} s the payload became {1e3 * abs(values['mass']):.0f} g {change}: "
            "the nominal model's payload does not change."
        )
