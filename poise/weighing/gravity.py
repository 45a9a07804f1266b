"""Readings of gravity: compensated by the robot's controller, of another size, or in another direction."""

from collections.abc import Callable, Mapping, Sequence

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.model import ENTRIES, signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, explain
from poise.weighing.reading import Reading, Repair, Says, shows_payload

_AWAY = np.radians(30.0)
"""From the direction of the forces alone to that of forces, torques and accelerations."""
_STANDARD_WITHIN = 0.03
"""Relative; a corrected gravity this close to the standard one means that gravity was given wrongly."""

_SURELY, _LEAST = 3.0, 0.05
"""Standard deviations, and share of the mass, from which on a compensated mass counts."""


def wrong_gravity(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """The weight of some payload taken off; gravity of another size; gravity in another direction."""
    del plain
    size = float(np.linalg.norm(samples.gravity))
    found = [
        Reading(ErrorCode.COMPENSATED, _without_weight, _all_compensated, repair=_weight_back),
        Reading(
            ErrorCode.COMPENSATED, with_free_weight(1), _compensated(1), holds=_takes_weight, repair=_compensation_back
        ),
        Reading(
            ErrorCode.COMPENSATED, with_free_weight(4), _compensated(4), holds=_takes_weight, repair=_compensation_back
        ),
    ]
    starts = [(np.log(STANDARD_GRAVITY / size),)]
    if abs(starts[0][0]) > _STANDARD_WITHIN:
        found.append(
            Reading(
                ErrorCode.GRAVITY_WRONG,
                _sized,
                _size_sentence(size),
                starts=tuple(starts),
                repair=lambda fit: _gravity_of_earth(fit, size),
            )
        )
    down = _directions(samples)
    found.append(
        Reading(
            ErrorCode.GRAVITY_WRONG,
            _leaning,
            _direction_sentence,
            starts=down,
            holds=_near(down),
            open_pull=lambda fit: float(abs(fit.phi[0]) * size * np.linalg.norm(_direction(fit.values)[:2])),
        )
    )
    return found


def weight_columns(gravity_in_sensor: Array) -> Array:
    """(N, 6, 4) the weight of m and m c at rest, in gravity (N, 3) in sensor axes."""
    signals = np.zeros((len(gravity_in_sensor), ENTRIES.shape[2]))
    signals[:, :3] = gravity_in_sensor
    return signal_columns(signals)[:, :, :4]


def _inertial(samples: FitSamples) -> Array:
    signals = samples.signals.copy()
    signals[:, :3] = -samples.acceleration_in_sensor
    return signal_columns(signals)


def _without_weight(samples: FitSamples, values: Array) -> Array:
    del values
    return _inertial(samples)


def _all_compensated(found: Explanation) -> tuple[str, Mapping[str, float]]:
    mass, deviation = float(found.phi[0]), found.mass_std
    return (
        f"the force shows no weight, but accelerations show {mass:.3f} +- {deviation:.3f} kg: the robot's controller"
        " or the driver compensates the payload: switch its payload compensation off, or set its payload to zero",
        {"compensated_mass": mass, "compensated_mass_std": deviation},
    )


def _weight_back(found: Explanation) -> Repair:
    return Repair(compensated=found.phi[:4])


def with_free_weight(count: int) -> Callable[[FitSamples, Array], Array]:
    """The design of a payload from whose weight that of another one is taken: of m, or of m and m c (count 1 or 4)."""

    def design(samples: FitSamples, values: Array) -> Array:
        del values
        weight = weight_columns(samples.gravity_in_sensor)
        return np.concatenate([signal_columns(samples.signals), weight[:, :, :count]], axis=2)

    return design


def _compensated(count: int) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        taken = -float(found.unknowns[16])
        deviation = float(np.sqrt(found.covariance[16, 16]))
        mass = float(found.phi[0])
        return (
            f"accelerations show {mass:.3f} +- {found.mass_std:.3f} kg, but the weight is that of {mass - taken:.3f}"
            f" kg: the robot's controller or the driver compensates {taken:.3f} +- {deviation:.3f} kg: switch its"
            " payload compensation off, or set its payload to zero",
            {"compensated_mass": taken, "compensated_mass_std": deviation, "n_parameters": float(count)},
        )

    return says


def _takes_weight(found: Explanation) -> bool:
    """Errors of the accelerations make the inertial mass too small: only a weight that is too small is compensated."""
    return shows_payload(found) and bool(
        -found.unknowns[16] > _SURELY * np.sqrt(found.covariance[16, 16]) + _LEAST * abs(found.phi[0])
    )


def _compensation_back(found: Explanation) -> Repair:
    taken = np.zeros(4)
    taken[: len(found.unknowns) - 16] = -found.unknowns[16:]
    return Repair(compensated=taken)


def _sized(samples: FitSamples, values: Array) -> Array:
    signals = samples.signals.copy()
    signals[:, :3] = np.exp(values[0]) * samples.gravity_in_sensor - samples.acceleration_in_sensor
    return signal_columns(signals)


def _gravity_of_earth(found: Explanation, size: float) -> Repair:
    """The standard one where the fit is close to it: inertial forces show the size of gravity less well."""
    fitted = float(np.exp(found.values[0]))
    standard = STANDARD_GRAVITY / size
    return Repair(gravity=standard if abs(fitted / standard - 1.0) < _STANDARD_WITHIN else fitted)


def _size_sentence(size: float) -> Says:
    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        fitted = size * float(np.exp(found.values[0]))
        deviation = fitted * float(found.value_stds[0])
        return (
            f"gravity was given as {size:.4g} m/s2, but weight and inertial forces agree at {fitted:.3g} +-"
            f" {deviation:.1g} m/s2: give --gravity {STANDARD_GRAVITY}",
            {"gravity": fitted, "gravity_std": deviation},
        )

    return says


def _direction(values: Sequence[float] | Array) -> Array:
    """(3,) unit vector: -z of the world turned by a roll and a pitch."""
    roll, pitch = values
    return np.array([np.sin(pitch), np.sin(roll) * np.cos(pitch), -np.cos(roll) * np.cos(pitch)])


def _near(starts: Sequence[Sequence[float]]) -> Callable[[Explanation], bool]:
    """Whether a fit has the direction of the forces: with few attitudes, a heavy load in another one fits, too."""

    def holds(found: Explanation) -> bool:
        nearest = max(float(_direction(found.values) @ _direction(start)) for start in starts)
        return shows_payload(found) and nearest > np.cos(_AWAY)

    return holds


def _leaning(samples: FitSamples, values: Array) -> Array:
    signals = samples.signals.copy()
    gravity = float(np.linalg.norm(samples.gravity)) * _direction(values)
    down = np.einsum("nji,j->ni", samples.rotation_world_sensor, gravity)
    signals[:, :3] = down - samples.acceleration_in_sensor
    return signal_columns(signals)


def _directions(samples: FitSamples) -> tuple[tuple[float, ...], ...]:
    """The direction of the weight in the world, from the force alone: f = R^T (m g) + b."""

    def design(part: FitSamples, values: Array) -> Array:
        inertial = _inertial(part)
        del values
        world = np.zeros((len(part), 6, 3))
        world[:, :3] = part.rotation_world_sensor.swapaxes(1, 2)
        return np.concatenate([inertial[:, :, :10], inertial[:, :, 10:], world], axis=2)

    usable = np.zeros(samples.wrench.shape, dtype=bool)
    usable[:, :3] = True
    weight = explain(samples, design, (), usable).unknowns[16:]
    down = weight / max(float(np.linalg.norm(weight)), 1e-9)
    return tuple(
        (float(np.arctan2(sign * down[1], -sign * down[2])), float(np.arcsin(np.clip(sign * down[0], -1, 1))))
        for sign in (1.0, -1.0)
    )


def _direction_sentence(found: Explanation) -> tuple[str, Mapping[str, float]]:
    roll, pitch = found.values.tolist()
    angle = float(np.arccos(np.clip(np.cos(roll) * np.cos(pitch), -1, 1)))
    return (
        f"the weight pulls {np.degrees(angle):.1f} degrees off the base frame's -z (roll {np.degrees(roll):.1f}, pitch"
        f" {np.degrees(pitch):.1f} degrees): the base is not upright, or a hose or a hand pulls at the load: correct"
        " the mounting of the base in the URDF or tf",
        {"roll": roll, "pitch": pitch, "roll_std": float(found.value_stds[0]), "pitch_std": float(found.value_stds[1])},
    )
