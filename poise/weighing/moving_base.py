"""A base that accelerates: an acceleration in the world that the motion lacks acts on the payload's own mass."""

from collections.abc import Mapping

import numpy as np

from poise.errors import ErrorCode
from poise.inertia.model import signal_columns
from poise.inertia.verdict import FitSamples
from poise.types import Array
from poise.weighing.fitting import Explanation, ReadingDesign, plain_design
from poise.weighing.reading import Reading, shows_payload

_SPACING = 0.4
"""s between knots of the acceleration."""
_MOST_KNOTS = 24
_FASTEST = 2.5
"""m/s by which the velocity of a base changes at most; a hose, and a joint's zero that is off, pull on and on."""
FLEXIBLE = -60.0
"""Log prior: a free course also explains errors that depend on the pose."""


def moving_base(samples: FitSamples, plain: Explanation) -> list[Reading]:
    """Horizontal accelerations with a free course."""
    if len(samples) < 50 or not plain.phi[0] > 3 * plain.mass_std:
        return []
    count = int(np.clip(samples.seconds[-1] / _SPACING, 4, _MOST_KNOTS))

    def course(found: Explanation) -> Array:
        return found.unknowns[16:].reshape(2, count)

    def says(found: Explanation) -> tuple[str, Mapping[str, float]]:
        return base_sentence(float(np.linalg.norm(course(found), axis=0).max()))

    def holds(found: Explanation) -> bool:
        return shows_payload(found) and drives(course(found), float(samples.seconds[-1]))

    design = on_moving_base(samples, count, plain.phi)
    return [Reading(ErrorCode.BASE_MOVED, design, says, prior=FLEXIBLE, holds=holds)]


def on_moving_base(samples: FitSamples, count: int, phi: Array) -> ReadingDesign:
    """A payload, and horizontal accelerations of it along x and y of the world, with courses of some knots each."""
    knots = hats(samples.seconds, count)

    def design(part: FitSamples, values: Array) -> Array:
        shape = knots if len(part) == len(knots) else hats(part.seconds, count)
        extra = [loads[:, :, None] * shape[:, None, :] for loads in _by_base(part, phi)]
        return np.concatenate([plain_design(part, values), *extra], axis=2)

    return design


def drives(course: Array, duration: float) -> bool:
    """Whether a base can accelerate so: (2, K) m/s2 at knots that are spread over s; it would not drive away."""
    speed = np.cumsum(course * duration / max(course.shape[1] - 1, 1), axis=1)
    return bool(np.ptp(speed, axis=1).max() < _FASTEST)


def base_sentence(largest: float) -> tuple[str, Mapping[str, float]]:
    """For an acceleration in m/s2."""
    return (
        f"the base accelerates by up to {largest:.2g} m/s2, and the motion lacks it: the residual is a horizontal"
        " force through the payload's own centre of mass: record odom (nav_msgs/Odometry) beside the joint states, or"
        " weigh while the base rests",
        {"base_acceleration": largest},
    )


def without_base(samples: FitSamples, found: Explanation) -> tuple[Array, Array]:
    """What the residual (N, 6) lacks when each sample has a horizontal acceleration (N, 2) m/s2 of its own."""
    size = np.repeat(np.maximum(np.exp(np.median(found.levels, axis=0)), 1e-6), 3)
    columns = np.stack(_by_base(samples, found.phi), axis=2) / size[:, None]
    residual = found.residual / size
    normal = np.einsum("nic,nid->ncd", columns, columns) + 1e-9 * np.eye(2)
    course = np.linalg.solve(normal, np.einsum("nic,ni->nc", columns, residual)[:, :, None])[:, :, 0]
    return (residual - np.einsum("nic,nc->ni", columns, course)) * size, course


def _by_base(samples: FitSamples, phi: Array) -> list[Array]:
    """Twice (N, 6): the wrench of a payload for 1 m/s2 of the base along x, and y, of the world."""
    found = []
    for axis in range(2):
        signals = np.zeros(samples.signals.shape)
        signals[:, :3] = -samples.rotation_world_sensor[:, axis, :]
        found.append(signal_columns(signals)[:, :, :10] @ phi)
    return found


def hats(seconds: Array, count: int) -> Array:
    """(N, count) linear interpolation between knots that are spread over the samples."""
    knots = np.linspace(seconds[0], seconds[-1], count)
    return np.stack([np.interp(seconds, knots, row) for row in np.eye(count)], axis=1)
