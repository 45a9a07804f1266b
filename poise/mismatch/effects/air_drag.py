"""Air drag: the air resists a broad load with the square of its speed."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_wrench import PAYLOAD_REACH, POINT_PARAMETERS, likely_place, payload_centre, place_of
from poise.mismatch.recorded import RecordedMotion, forces_at
from poise.types import Array


class AirDrag(Effect):
    """f = -k |v| v at a point of the tool, v its velocity in still air."""

    name = "air_drag"
    layer = "load"
    equation = "f = -k |v| v, tau = p x f, v = R^T v_sensor + omega x p; k = rho A c_d / 2"
    source = "Newton's drag at high Reynolds number (Batchelor 1967, chapter 5)"
    excited_by = "fast, long strokes"
    separating_motion = "the same stroke at half and at full speed, both ways: drag grows by four and changes sign"
    confused_with = ("cable", "flywheel", "low_pass", "clock_offset")

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        places = (
            EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
            for name in POINT_PARAMETERS
        )
        return (*places, EffectParameter("coefficient", "N s2/m2", 1.5, positive=True))

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The point from the torque, with the force of the drag at the payload's centre."""
        centre = payload_centre(recorded)
        force = self._per_unit(recorded, centre)
        centred = force - force.mean(axis=0)
        wanted = residual - residual.mean(axis=0)
        size = float(np.sum(centred * wanted[:, :3]) / max(float(np.sum(centred**2)), 1e-12))
        place = likely_place(size * centred, wanted[:, 3:]) if size > 0.0 else centre
        for point in (centre, place):
            yield dict(zip(POINT_PARAMETERS, point.tolist(), strict=True))

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        place = place_of(nonlinear)
        return forces_at(place, self._per_unit(recorded, place))[:, :, None]

    def untestable(self, recorded: RecordedMotion) -> str:
        lacking = super().untestable(recorded)
        fastest = float(np.linalg.norm(recorded.velocity_in_world, axis=1).max())
        return lacking or ("" if fastest > 0.05 else f"the tool never moves faster than {fastest:.2f} m/s")

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        force = np.linalg.norm(values["coefficient"] * self._per_unit(recorded, place_of(values)), axis=1)
        return (
            f"Air drag resists the load with {values['coefficient']:.2f} N s2/m2, up to {force.max():.1f} N at the "
            "highest speed: the nominal load moves in a vacuum."
        )

    @staticmethod
    def _per_unit(recorded: RecordedMotion, place: Array) -> Array:
        """(N, 3) force at coefficient 1."""
        speed = recorded.to_sensor(recorded.velocity_in_world) + cross(recorded.angular_velocity, place)
        return np.asarray(-speed * np.linalg.norm(speed, axis=1, keepdims=True))
