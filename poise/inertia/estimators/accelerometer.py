"""Offset and scale of an accelerometer that gives the sensor's motion, and what they do to payload and bias."""

from dataclasses import dataclass, replace
from enum import Enum

import numpy as np

from poise.geometry import cross_matrix
from poise.inertia.model import InertialSolution
from poise.robot import SensorMotion
from poise.types import Array, Stamps

_SCALE_SPREAD, _AXIS_SPREAD = 0.01, 0.01
"""Relative error of the scale before a comparison, and what each axis has of its own."""

OFFSET_SPREAD = 0.5
"""m/s2: offset of each axis before a comparison."""

_MISALIGNED = 0.05
"""m/s2: gravity on axes that are mounted, or kinematics that are calibrated, to 5 mrad."""

_SPEED = 0.5
"""m/s, one sigma in each direction, at which a hand moves. Accelerations integrate to differences of velocities."""

_WINDOW = 1_000_000_000
"""ns over which accelerations are integrated."""

_LARGEST_GAP = 100_000_000
"""ns between samples across which they are not."""

_MOST_WINDOWS = 64


class Accelerometer(Enum):
    """What an accelerometer contributes to the motion."""

    NONE = "nothing: accelerations are derivatives"
    ON_KINEMATICS = "the linear acceleration; attitudes come from kinematics"
    ALONE = "the linear acceleration, and attitudes with a gyroscope"


@dataclass(frozen=True, eq=False)
class AccelerometerErrors:
    """A reading is (1 + scale) times the specific force g - a, plus the offset, along each axis of the sensor frame.

    Args:
        scale: (3,).
        offset: (3,) m/s2.
        covariance: (6, 6) of both.
        weights: (3,) share of each axis in the weight that the samples show; they add up to 1.
        mean_gravity: (3,) m/s2 in the sensor frame, over the samples.
    """

    scale: Array
    offset: Array
    covariance: Array
    weights: Array
    mean_gravity: Array

    def true_motion(self, motion: SensorMotion, gravity: Array) -> SensorMotion:
        """The motion with the true linear acceleration, for gravity (3,) m/s2 in the world."""
        down = motion.gravity_in_sensor(gravity)
        specific = (down - motion.linear_acceleration_in_sensor - self.offset) / (1 + self.scale)
        return replace(motion, linear_acceleration_in_sensor=down - specific)

    def corrected(self, solution: InertialSolution) -> InertialSolution:
        """The solution for true specific forces, from that for the readings; the errors' uncertainty is added.

        An offset of the accelerometer looks like a bias of the force sensor, of the offset times the mass. A scale
        looks like another mass. Scales that differ from axis to axis act as an offset, of the mean gravity.
        """
        mass, first = float(solution.phi[0]), solution.phi[1:4]
        uneven = np.diag(self.mean_gravity) - np.outer(self.mean_gravity, self.weights)
        by_errors = np.hstack([uneven, np.eye(3)])  # (3, 6) of the force per mass
        errors = np.concatenate([self.scale, self.offset])
        wrench = np.vstack([mass * by_errors, cross_matrix(first) @ by_errors])
        grown = 1 + float(self.weights @ self.scale)
        variance = float(self.weights @ self.covariance[:3, :3] @ self.weights)
        return replace(
            solution,
            phi=grown * solution.phi,
            covariance=grown**2 * solution.covariance + variance * np.outer(solution.phi, solution.phi),
            bias=solution.bias + wrench @ errors,
            bias_covariance=solution.bias_covariance + wrench @ self.covariance @ wrench.T,
        )


class AccelerometerComparison:
    """Compares accelerations that come from an accelerometer with the attitudes that belong to them.

    With the right offset and scale they integrate to differences of velocities, which are small for a robot. Sums over
    windows of time are kept; adding samples in other portions gives the same sums.

    Args:
        gravity: (3,) m/s2 in the world, along z.
        kind: what the accelerometer contributes. ALONE, the direction of gravity is its own, and proves nothing.
    """

    def __init__(self, gravity: Array, kind: Accelerometer) -> None:
        self._gravity, self._kind = gravity, kind
        self._keys: list[tuple[int, int]] = []
        """Of each window: the stretch without gaps that it belongs to, and its second."""
        self._sums = np.zeros((0, 3, 8))
        """Of each window: integrals in the world of the six columns of the errors, the readings, and the time."""
        self._last: SensorMotion | None = None
        self._stretch = 0
        self._n, self._gravity_sum, self._gravity_squares = 0, np.zeros(3), np.zeros(3)

    def add(self, motion: SensorMotion) -> None:
        """Take samples in the order of time; held poses, whose acceleration is exactly zero, are not the sensor's."""
        if self._kind is Accelerometer.NONE:
            return
        motion = motion.select(motion.linear_acceleration_in_sensor.any(axis=1))
        if not len(motion):
            return
        down = motion.gravity_in_sensor(self._gravity)
        self._n += len(motion)
        self._gravity_sum = np.add.accumulate(np.vstack([self._gravity_sum, down]))[-1]
        self._gravity_squares = np.add.accumulate(np.vstack([self._gravity_squares, down**2]))[-1]
        rows = _world_rows(motion, down)
        if self._last is not None:
            before = _world_rows(self._last, self._last.gravity_in_sensor(self._gravity))
            rows = np.concatenate([before, rows])
        stamps = motion.stamps if self._last is None else np.append(self._last.stamps, motion.stamps)
        self._last = motion.select(slice(-1, None))
        self._integrate(stamps, rows)

    def errors(self) -> AccelerometerErrors | None:
        """What the samples show of the accelerometer; None without samples."""
        if not self._n:
            return None
        squares = self._gravity_squares / self._gravity_squares.sum()
        mean, information = np.zeros(6), np.linalg.inv(_prior_covariance())
        vector, left, count = np.zeros(6), 0.0, 0
        axes = (2,) if self._kind is Accelerometer.ALONE else (0, 1, 2)
        seconds = self._sums[:, 0, 7]
        if len(seconds):
            noise, tilt = self._noise(), _MISALIGNED**2 * np.outer(seconds, seconds)
            systems = [np.linalg.inv(noise + (tilt if axis < 2 else 0.0)) for axis in axes]
            parts = [(self._sums[:, axis], system) for axis, system in zip(axes, systems, strict=True)]
            information = information + sum(rows[:, :6].T @ system @ rows[:, :6] for rows, system in parts)
            vector = sum((rows[:, :6].T @ system @ rows[:, 6] for rows, system in parts), vector)
            mean = np.linalg.solve(information, vector)
            for rows, system in parts:
                rest = rows[:, 6] - rows[:, :6] @ mean
                left, count = left + float(rest @ system @ rest), count + len(rest)
        excess = max(left / max(count, 1), 1.0)
        covariance = np.linalg.inv(information) * excess + np.diag(np.repeat([0.0, _MISALIGNED**2], 3))
        return AccelerometerErrors(mean[:3], mean[3:], covariance, squares, self._gravity_sum / self._n)

    def _integrate(self, stamps: Stamps, rows: Array) -> None:
        """Add the trapezoids between samples to their windows."""
        steps = np.diff(stamps)
        if not len(steps):
            return
        stretch = self._stretch + np.cumsum(steps > _LARGEST_GAP)
        self._stretch = int(stretch[-1])
        usable = (steps > 0) & (steps <= _LARGEST_GAP)
        pieces = np.empty((len(steps), 3, 8))
        pieces[..., :7] = (rows[1:] + rows[:-1]) / 2
        pieces[..., 7] = 1.0
        pieces *= (steps * 1e-9)[:, None, None]
        keys = np.stack([stretch, stamps[1:] // _WINDOW], axis=1)[usable]
        begins = np.flatnonzero(np.diff(keys, axis=0, prepend=keys[:1] - 1).any(axis=1))
        for begin, end in zip(begins, [*begins[1:], len(keys)], strict=True):
            self._window(tuple(keys[begin].tolist()))
            # One by one, so that rounding does not depend on the portions.
            self._sums[-1] = np.add.accumulate(np.concatenate([self._sums[-1:], pieces[usable][begin:end]]))[-1]

    def _window(self, key: tuple[int, int]) -> None:
        """Begin another window, unless it is the last one."""
        if self._keys and key == self._keys[-1]:
            return
        if len(self._keys) >= _MOST_WINDOWS:
            self._merge()
        self._keys.append(key)
        self._sums = np.concatenate([self._sums, np.zeros((1, 3, 8))])

    def _merge(self) -> None:
        """Join windows two by two, so that their number stays bounded; across a gap the velocity is forgotten."""
        self._sums = self._sums[::2] + self._sums[1::2]
        self._keys = self._keys[::2]

    def _noise(self) -> Array:
        """(W, W) covariance of the velocity differences: neighbours share the velocity between them."""
        count = len(self._keys)
        linked = [first[0] == second[0] for first, second in zip(self._keys, self._keys[1:], strict=False)]
        return np.asarray(_SPEED**2 * (2 * np.eye(count) - np.diag(linked, 1) - np.diag(linked, -1)))


def _world_rows(motion: SensorMotion, down: Array) -> Array:
    """(N, 3, 7) in the world, m/s2: what scales and offsets of 1 add to a reading at rest, and what motion adds."""
    rotation = motion.rotation_world_sensor
    rest = np.einsum("nij,nj->ni", rotation, -motion.linear_acceleration_in_sensor)
    return np.concatenate([rotation * down[:, None, :], rotation, rest[..., None]], axis=2)


def _prior_covariance() -> Array:
    scales = _SCALE_SPREAD**2 * np.ones((3, 3)) + _AXIS_SPREAD**2 * np.eye(3)
    result = np.zeros((6, 6))
    result[:3, :3], result[3:, 3:] = scales, OFFSET_SPREAD**2 * np.eye(3)
    return result
