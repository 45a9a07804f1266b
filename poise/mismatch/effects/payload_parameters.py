"""Payload parameters: the load differs from the payload of the model."""

import numpy as np

from poise.inertia.model import InertialParameters, regressor
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

PAYLOAD_PARAMETERS = ("mass", "moment_x", "moment_y", "moment_z", "ixx", "ixy", "ixz", "iyy", "iyz", "izz")

FARTHEST_CENTRE = 1.0
"""m from the sensor to a payload's centre of mass."""
_OF_NONE = (1.0, 0.05)
"""Typical mass, relative, and m of its lever, of a payload where the model has none: a hand that was forgotten."""


class PayloadParameters(Effect):
    """phi_true = phi + dphi, linear in the ten parameters (m, m c, I about the sensor's origin)."""

    name = "payload_parameters"
    layer = "load"
    equation = "w = A(g - a, omega, alpha) (phi + dphi)"
    source = "thesis eq. 2.97; Atkeson, An, Hollerbach 1986"
    excited_by = "gravity in several directions (mass, centre of mass); angular acceleration (inertia)"
    separating_motion = "six attitudes, then quick turns about all axes"
    confused_with = ("sensor_gain", "sensor_bias", "mass_step", "mass_leak", "world_force")
    widens = "payload"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        mass = max(float(recorded.phi[0]), 0.5)
        of_mass, arm = (0.15, 0.02) if recorded.phi[0] else _OF_NONE
        return (
            EffectParameter("mass", "kg", of_mass * mass),
            *(EffectParameter(name, "kg m", arm * mass, hidden=True) for name in PAYLOAD_PARAMETERS[1:4]),
            *(EffectParameter(name, "kg m2", 0.005 * mass, hidden=True) for name in PAYLOAD_PARAMETERS[4:]),
        )

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        return regressor(recorded.specific, recorded.angular_velocity, recorded.angular_acceleration)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        body, nominal = self._body(recorded, values), InertialParameters.from_phi(recorded.phi)
        # A model without a payload has no centre of mass: that of the payload itself is reported.
        com = np.nan_to_num(body.com) - np.nan_to_num(nominal.com)
        inertia = np.nan_to_num(body.inertia_vector) - np.nan_to_num(nominal.inertia_vector)
        reported = {f"com_{axis}": (float(value), "m") for axis, value in zip("xyz", com, strict=True)}
        return reported | {
            f"inertia_{row[1:]}": (float(value), "kg m2")
            for row, value in zip(PAYLOAD_PARAMETERS[4:], inertia, strict=True)
        }

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A mass is not negative, and its centre lies within reach of the sensor."""
        body = recorded.phi + np.array([values[name] for name in PAYLOAD_PARAMETERS])
        least = 0.05 * max(float(recorded.phi[0]), 0.5)
        if body[0] < -least:
            return f"the payload would weigh {body[0]:.2f} kg"
        far = np.linalg.norm(body[1:4]) > FARTHEST_CENTRE * max(float(body[0]), 0.0) + least
        return "its centre of mass would lie outside the payload" if far else ""

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        body = self._body(recorded, values)
        if body.mass < 0.05 * max(float(recorded.phi[0]), 0.1):
            return f"The payload of {recorded.phi[0]:.2f} kg is not there: the sensor carries {body.mass:.2f} kg."
        place = ", ".join(f"{1e3 * value:.1f}" for value in body.com)
        return (
            f"The payload weighs {body.mass:.3f} kg with its centre of mass at ({place}) mm: "
            f"the nominal model has {recorded.phi[0]:.3f} kg."
        )

    @staticmethod
    def _body(recorded: RecordedMotion, values: Values) -> InertialParameters:
        return InertialParameters.from_phi(recorded.phi + np.array([values[name] for name in PAYLOAD_PARAMETERS]))
