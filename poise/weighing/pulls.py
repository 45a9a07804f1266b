"""A hose or a cable: a force with a free course in the world that pulls at one point of the tool all the time."""

from collections.abc import Callable, Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.geometry import STANDARD_GRAVITY
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign, explain, impossible, plain_design
from poise.weighing.moving_base import FLEXIBLE, drives, hats, on_moving_base
from poise.weighing.reading import Reading, shows_payload

_KNOTS = (1, 2, 6, 12, 24)
"""Of the course of each component; one: it is constant."""
_STIFF = 2
"""Knots up to which a course does not follow the pose."""
_HOPE = 0.4
"""Share of its cost that a course explains before one with more knots is tried."""
_SPACING = 0.4
"""s between knots, at least."""
_RARE = -4.0
_NATS = 3.0
"""That a further parameter has to gain."""
_USUAL_POINT = np.array([0.0, 0.0, 0.1])
"""m from the sensor."""


def pulled(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """A force that pulls at a point of the tool, or horizontally at the centre of mass, with a free course in time.

    The mean of a vertical component is left out: it looks like weight, so that `open_pull` counts it as unknown.
    """
    mass = float(plain.phi[0])
    if len(samples) < 50:
        return []
    shows_mass = mass > 3 * plain.mass_std
    point = tuple((plain.phi[1:4] / mass if shows_mass else _USUAL_POINT).tolist())
    found = []
    if count := _best_count(samples, plain, lambda count: _at_point(samples, count), point):
        found.append(_anywhere(samples, count, point))
    by_mass = (
        _best_count(samples, plain, lambda count: on_moving_base(samples, count, plain.phi), ()) if shows_mass else 0
    )
    if by_mass > _STIFF:  # a constant one is gravity in another direction
        found.append(_horizontal(samples, by_mass, plain.phi))
    return found


def _best_count(
    samples: FitSamples, plain: Explanation, design: Callable[[int], ReadingDesign], values: tuple[float, ...]
) -> int:
    """The number of knots that explains most for its cost; 0: none explains more than it costs."""
    gains = {0: 0.0}
    for count in _KNOTS:
        if count == 1 or count * _SPACING < samples.seconds[-1]:
            found = explain(samples, design(count), values, quick=True)
            gain, cost = 3 * float(np.sum(plain.levels - found.levels)), _NATS * found.n_free
            gains[count] = gain - cost
            if count > _STIFF and gain < _HOPE * cost:
                break  # more knots cost more than they explain
    return max(gains, key=lambda count: gains[count])


def _anywhere(samples: FitSamples, count: int, point: tuple[float, ...]) -> Reading:
    def size(found: Explanation) -> float:
        return _rms(samples, found.unknowns[16 : 16 + 2 * count].reshape(2, count))

    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        x, y, z = found.values.tolist()
        return (
            f"a force of about {size(found):.2g} N pulls all the time at ({x:.2f}, {y:.2f}, {z:.2f}) m of the sensor"
            " frame, as a hose or a cable does; its mean downwards cannot be distinguished from weight: lead it so that"
            " it does not pull, or identify it with poise mismatch",
            {"pull": size(found), "point_x": x, "point_y": y, "point_z": z},
        )

    prior = _RARE if count <= _STIFF else FLEXIBLE
    return Reading(
        ErrorCode.IN_CONTACT,
        _at_point(samples, count),
        says,
        starts=(point,),
        prior=prior,
        holds=lambda found: not impossible(found),  # a hose may carry the payload
        open_pull=size,
    )


def _horizontal(samples: FitSamples, count: int, phi: Array) -> Reading:
    def course(found: Explanation) -> Array:
        return found.unknowns[16:].reshape(2, count)

    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        largest, mass = float(np.linalg.norm(course(found), axis=0).max()), float(found.phi[0])
        angle = float(np.arctan(largest / STANDARD_GRAVITY))
        return (
            f"a horizontal force of up to {largest * mass:.2g} N pulls all the time, and a base that it would move"
            " would drive away: a hose or a cable pulls, or the zero of a joint is off by up to"
            f" {np.degrees(angle):.1f} degrees: lead the hose so that it does not pull, or calibrate the joints",
            {"pull": largest * mass, "angle": angle},
        )

    return Reading(
        ErrorCode.POOR_FIT,
        on_moving_base(samples, count, phi),
        says,
        prior=FLEXIBLE,
        holds=lambda found: shows_payload(found) and not drives(course(found), float(samples.seconds[-1])),
        open_pull=lambda found: float(found.phi[0]) * _rms(samples, course(found)),
    )


def _at_point(samples: FitSamples, count: int) -> ReadingDesign:
    whole = hats(samples.seconds, count)
    upright = (whole - whole.mean(axis=0))[:, :-1]

    def design(part: FitSamples, values: Array) -> Array:
        columns = [plain_design(part, values)]
        for axis, course in enumerate((whole, whole, upright)):
            force = part.rotation_world_sensor[:, axis, :]
            wrench = np.concatenate([force, np.cross(values, force)], axis=1)
            columns.append(wrench[:, :, None] * course[:, None, :])
        return np.concatenate(columns, axis=2)

    return design


def _rms(samples: FitSamples, course: Array) -> float:
    """Rms of a component of a course (2, K); the vertical one is as large, and unknown."""
    return float(np.sqrt(np.mean((hats(samples.seconds, course.shape[1]) @ course.T) ** 2)))
