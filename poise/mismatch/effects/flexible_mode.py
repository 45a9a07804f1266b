"""Flexible mode: a part of the payload is mounted on a spring and oscillates along an axis."""

from collections.abc import Iterable

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import Oscillator
from poise.mismatch.effects.part_wrench import (
    AXIS_PARAMETERS,
    PAIRS,
    PAYLOAD_REACH,
    POINT_PARAMETERS,
    beside_errors,
    best_fit,
    by_axis,
    chart,
    damping_parameter,
    direction,
    likely_place,
    named_axis,
    no_part,
    payload_centre,
    place_of,
    sliding_wrench,
    specific_at,
    spin_square,
)
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

_FREQUENCIES, _STARTS = tuple(np.geomspace(2.0, 14.0, 10).tolist()), 3
"""Hz that are tried, and how many of them the search begins from."""

_MOST_OF_LOAD = 0.5
"""Share of the payload from which what oscillates is as likely the whole payload, in a grasp that gives about one axis:
its modal mass is m d^2 / (d^2 + k^2), with d from the hinge to the centre of mass and k the radius of gyration."""


class FlexibleMode(Effect):
    """A mass on a spring and damper along an axis of the tool; without load it is at its nominal place.

    Its mass is part of the nominal payload: the response is the difference that its oscillation makes. A beam has a
    mode in each of two directions: a model may have two.
    """

    name = "flexible_mode"
    layer = "load"
    equation = "z'' + 2 zeta w z' + (w^2 - spin) z = n.(g - a_p); part at p + n z instead of at p"
    source = "one mode of a flexible appendage (Inman 2014, section 2.4) in a turning frame (Craig 2005, section 6.2)"
    excited_by = "starts and stops that are shorter than the mode's period; gravity along the axis, slowly"
    separating_motion = "a sudden stop, then rest: the mode rings at its own frequency, in any attitude"
    confused_with = ("grasp_compliance", "slosh", "payload_parameters", "external_vibration", "low_pass")
    needs = ("load",)
    most = 2

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("frequency", "Hz", low=1.5, high=30.0, linear=False, log=True),
            damping_parameter(0.003, 0.7),
            *(EffectParameter(name, "", low=-1.9, high=1.9, linear=False, hidden=True) for name in AXIS_PARAMETERS),
            *(
                EffectParameter(name, "m", low=-PAYLOAD_REACH, high=PAYLOAD_REACH, linear=False)
                for name in POINT_PARAMETERS
            ),
            EffectParameter("mass", "kg", 0.5, positive=True),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """At some frequencies the axis and mass that fit best: the response is linear in m n n^T, and m > 0.

        The torque of a swing n z is m (n x u)(n.Z) with Z the swing that u would make along every axis. Errors of the
        calibration explain most of the sag under gravity: they are left out of both.
        """
        place = payload_centre(recorded)
        weight = np.repeat([1.0, 20.0], 3)
        wanted = (beside_errors(recorded, residual) * weight).ravel()
        found = []
        for frequency in _FREQUENCIES:
            columns = self._tensor(recorded, place, frequency, 0.05)
            bare = beside_errors(recorded, columns)
            flat = (bare * weight[:, None]).reshape(-1, 6)
            entries, _ = best_fit(flat, wanted)
            matrix = np.zeros((3, 3))
            for (i, j), entry in zip(PAIRS, entries, strict=True):
                matrix[i, j] = matrix[j, i] = entry
            axis = np.linalg.eigh(matrix)[1][:, -1]
            alone = flat @ np.array([axis[i] * axis[j] for i, j in PAIRS])
            drop = max(float(alone @ wanted), 0.0) ** 2 / max(float(alone @ alone), 1e-300)
            found.append((drop, {"frequency": frequency, "damping_ratio": 0.05, **chart(axis)}))
        for _, nonlinear in sorted(found, key=lambda item: -item[0])[:_STARTS]:
            better = self._better_place(recorded, residual, nonlinear, place)
            yield {**nonlinear, **dict(zip(POINT_PARAMETERS, better.tolist(), strict=True))}

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        place, axis = place_of(nonlinear), direction(nonlinear)
        omega = 2.0 * np.pi * nonlinear["frequency"]
        pull, spin = specific_at(recorded, place) @ axis, spin_square(recorded, axis)
        damping = 2.0 * nonlinear["damping_ratio"] * omega
        # The spin weakens the spring: constant between stamps.
        stiffness = np.maximum(omega**2 - (spin[1:] + spin[:-1]) / 2.0, 0.1 * omega**2)
        z, dz = (part[:, 0] for part in Oscillator(recorded.seconds, stiffness, damping)(pull[:, None]))
        second = pull + spin * z - damping * dz - omega**2 * z
        return sliding_wrench(recorded, place, axis, (z, dz, second))[:, :, None]

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        return super().implausible(recorded, values) or no_part(recorded, values, values["mass"])

    def twins(self, recorded: RecordedMotion, values: Values) -> tuple[str, ...]:
        return ("grasp_compliance",) if values["mass"] > _MOST_OF_LOAD * recorded.phi[0] else ()

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        return named_axis(values)

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return (
            f"{values['mass']:.2f} kg of the payload oscillate at {values['frequency']:.1f} Hz along "
            f"{'xyz'[int(np.argmax(np.abs(direction(values))))]}, damping ratio {values['damping_ratio']:.2f}: "
            "the nominal payload is rigid."
        )

    @staticmethod
    def _tensor(recorded: RecordedMotion, place: Array, frequency: float, damping_ratio: float) -> Array:
        """(N, 6, 6) response to the entries of m n n^T, for a tool that turns slowly."""
        omega = 2.0 * np.pi * frequency
        damping = 2.0 * damping_ratio * omega
        pull = specific_at(recorded, place)
        z, dz = Oscillator(recorded.seconds, omega**2, damping)(pull)
        second = pull - damping * dz - omega**2 * z
        # The part of axis a under the swing of axis b: force -e_a z_b'', torque e_a x pull z_b - p x e_a z_b''.
        axes = np.eye(3)
        turned = cross(axes, pull[:, None]).swapaxes(1, 2)[:, :, :, None] * z[:, None, None, :]
        force = np.broadcast_to(-axes[None, :, :, None] * second[:, None, None, :], turned.shape)
        lever = -cross(place, axes).T[None, :, :, None] * second[:, None, None, :]
        whole = np.concatenate([force, turned + lever], axis=1)
        return by_axis(whole)

    def _better_place(self, recorded: RecordedMotion, residual: Array, nonlinear: Values, place: Array) -> Array:
        """The point of attack that explains the torque, for a known axis and frequency."""
        response = self.columns(recorded, {**nonlinear, **dict(zip(POINT_PARAMETERS, place.tolist(), strict=True))})[
            :, :, 0
        ]
        centred, wanted = beside_errors(recorded, response), beside_errors(recorded, residual)
        mass = float(np.sum(centred[:, :3] * wanted[:, :3]) / max(float(np.sum(centred[:, :3] ** 2)), 1e-12))
        shifted = place + likely_place(mass * centred[:, :3], wanted[:, 3:] - mass * centred[:, 3:])
        return np.asarray(np.clip(shifted, -0.9 * PAYLOAD_REACH, 0.9 * PAYLOAD_REACH))
