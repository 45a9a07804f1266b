"""Mass step: at one moment the payload changes, as when a part is dropped, or picked up for a while."""

from collections.abc import Iterable
from typing import ClassVar

import numpy as np

from poise.inertia.model import phi_of_pseudo_inertia, regressor
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import PAYLOAD_REACH
from poise.mismatch.effects.payload_parameters import FARTHEST_CENTRE
from poise.mismatch.effects.starts import steps
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_ROWS = ("mass", "moment_x", "moment_y", "moment_z")

_BESIDE = 0.5
"""s that a recording must show before and after the change; the first 0.4 s are not compared."""


class MassStep(Effect):
    """phi(t) = phi + dphi from `time` on, for `length` where a part is picked up and put down again.

    A small part near the payload's centre of mass c0: of its inertia about the sensor, dm c c', what is linear in dm
    and dm c counts; dm (c - c0) (c - c0)' is left out.
    """

    name = "mass_step"
    layer = "event"
    equation = "w = A(t) (phi + dphi [time <= t < time + length]), dphi = (dm, dm c)"
    source = "thesis eq. 2.97 with a payload that changes, and may change back"
    excited_by = "gravity; the time is resolved to a sample"
    separating_motion = "turn the tool after the change: weight turns with gravity, a bias does not"
    confused_with = ("mass_leak", "contact", "sensor_bias", "bias_drift")
    transfers = False
    defaults: ClassVar[Values] = {"returns": 0.0, "length": 1.0}

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
            EffectParameter("returns", "", low=0.0, high=1.0, linear=False, choice=True, hidden=True),
            EffectParameter(
                "length",
                "s",
                low=_BESIDE,
                high=max(recorded.duration, 2.0 * _BESIDE),
                linear=False,
                resolution=recorded.period,
                hidden=True,
            ),
            EffectParameter("mass", "kg", 0.3),
            *(EffectParameter(name, "kg m", 0.03) for name in _ROWS[1:]),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        for begin, end in steps(recorded, residual, self.columns(recorded, {"time": -np.inf})):
            returns = np.isfinite(end)
            if returns and self._unseen(recorded, begin):
                continue  # beside a constant, as one that begins where this one ends
            yield {"time": begin, "returns": float(returns), "length": end - begin if returns else _BESIDE}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        begin, end = _span(nonlinear)
        changed = (recorded.seconds >= begin) & (recorded.seconds < end) & recorded.recording_of(begin)
        matrix = regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)
        return np.asarray(matrix @ _part(recorded.phi) * changed[:, None, None])

    def inert(self, values: Values) -> tuple[str, ...]:
        return () if values.get("returns") else ("length",)

    def windows(self, recorded: RecordedMotion, values: Values) -> tuple[tuple[float, float], ...]:
        begin, end = _span(values)
        return ((begin, min(end, float(recorded.seconds[recorded.recording_of(begin)][-1]))),)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        mass = values["mass"] or 1e-9
        end = _span(values)[1]
        ended = {"end": (end, "s")} if np.isfinite(end) else {}
        return {**{axis: (values[f"moment_{axis}"] / mass, "m") for axis in "xyz"}, **ended}

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """The first moment changes by at most the reach of the payload times the mass that is there or comes.

        A brief change is a push. A change at an end of a single recording is none: nothing shows the payload before it
        or after it.
        """
        if self._unseen(recorded, values["time"]):
            return "the payload would change at the end or the start of the recording"
        ((start, end),) = self.windows(recorded, values)
        if end - start < _BESIDE:
            return f"the payload would change for {end - start:.2f} s"
        moment = np.linalg.norm([values[name] for name in _ROWS[1:]])
        mass = max(float(recorded.phi[0]), 0.5) + abs(values["mass"])
        return "the mass that changes would lie outside the payload" if moment > FARTHEST_CENTRE * mass else ""

    @staticmethod
    def _unseen(recorded: RecordedMotion, time: float) -> bool:
        """Whether a single recording does not show the payload before a time, or after it."""
        return not (recorded.begins or _BESIDE < time - recorded.seconds[0] < recorded.duration - _BESIDE)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        change = "heavier" if values["mass"] > 0 else "lighter"
        ((start, end),) = self.windows(recorded, values)
        again = "" if self.inert(values) else f", and at {end:.2f} s as it was before"
        moment = float(np.linalg.norm([values[name] for name in _ROWS[1:]]))
        if recorded.phi[0] > 0.0 and moment > PAYLOAD_REACH * abs(values["mass"]):
            moved = 1e3 * moment / float(recorded.phi[0])
            return (
                f"At {start:.2f} s a part of the payload moved: its centre of mass by {moved:.0f} mm, while its mass "
                f"stayed ({1e3 * values['mass']:+.0f} g){again}; the nominal model's payload does not change."
            )
        return (
            f"At {start:.2f} s the payload became {1e3 * abs(values['mass']):.0f} g {change}{again}: "
            "the nominal model's payload does not change."
        )


def _part(phi: Array) -> Array:
    """(10, 4) change of phi by the mass and the moment of a small part near the centre of mass of a payload phi.

    For a part at c near c0, m c c' = h c0' + c0 h' - m c0 c0' + m (c - c0) (c - c0)', h = m c.
    """
    steps = np.empty((10, 4))
    centre = phi[1:4] / phi[0] if phi[0] > 0.0 else np.zeros(3)
    for column, (mass, *moment) in enumerate(np.eye(4)):
        second = np.outer(moment, centre) + np.outer(centre, moment) - mass * np.outer(centre, centre)
        first = np.array(moment)[:, None]
        steps[:, column] = phi_of_pseudo_inertia(np.block([[second, first], [first.T, np.array([[mass]])]]))
    return steps


def _span(values: Values) -> tuple[float, float]:
    """(begin, end), s; the end of a change that stays is infinite."""
    begin = values["time"]
    return begin, begin + values["length"] if values.get("returns") else np.inf
