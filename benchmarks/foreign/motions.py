"""Reference motions: trapezoidal profiles, sums of sines, pick and place with pauses, jogging by hand."""

from collections.abc import Callable

import numpy as np
from scipy.interpolate import CubicSpline
from scipy.ndimage import uniform_filter1d

from benchmarks.foreign.robots import Array, Robot

STEP = 1e-3
"""s, of references, controllers and simulations."""

Reference = tuple[Array, Array, Array]
"""Position, velocity and acceleration, (N, J) each, at multiples of STEP."""


def trapezoidal(robot: Robot, seconds: float, rng: np.random.Generator) -> Reference:
    """Moves between random points with constant acceleration, all joints at once; pauses of up to 0.3 s."""
    speed, home, reach = (np.array(v) for v in (robot.speed, robot.home, robot.reach))
    return _sequence(home, lambda q: home + reach * rng.uniform(-1, 1, len(q)), speed, (0.0, 0.3), 0.3, seconds, rng)


def pick_and_place(robot: Robot, seconds: float, rng: np.random.Generator) -> Reference:
    """Smooth moves round a cycle of four points with pauses of 0.5 to 2 s."""
    home, reach, speed = (np.array(v) for v in (robot.home, robot.reach, robot.speed))
    points = home + reach * rng.uniform(-1, 1, (4, len(home)))
    count = iter(range(10**6))
    return _sequence(points[3], lambda _: points[next(count) % 4], 0.9 * speed, (0.5, 2.0), 1.0, seconds, rng)


def multi_sine(robot: Robot, seconds: float, rng: np.random.Generator) -> Reference:
    """Five sines a joint between 0.05 and 0.8 Hz, scaled to the joint's reach and speed."""
    times = _times(seconds)[:, None, None]
    count = len(robot.home)
    frequency = 2 * np.pi * rng.uniform(0.05, 0.8, (count, 5))
    phase, weight = rng.uniform(0, 2 * np.pi, (count, 5)), rng.uniform(0.3, 1.0, (count, 5)) / np.sqrt(frequency)
    ramp = np.sin(np.pi / 2 * np.clip(times[:, 0] / 1.5, 0, 1)) ** 2
    ramp = uniform_filter1d(ramp, 101, axis=0, mode="nearest")
    v = ramp * (weight * frequency * np.cos(frequency * times + phase)).sum(2)
    q, v, a = _centred(np.zeros(count), v)
    scale = np.minimum(np.array(robot.reach) / np.abs(q).max(0), np.array(robot.speed) / np.abs(v).max(0))
    return np.array(robot.home) + q * scale, v * scale, a * scale


def jogging(robot: Robot, seconds: float, rng: np.random.Generator) -> Reference:
    """One or two joints at a time, by the speed that a hand sets with a stick, within the reach."""
    times, count = _times(seconds), len(robot.home)
    speed, reach = np.array(robot.speed), np.array(robot.reach)
    command, position, t = np.zeros((len(times), count)), np.zeros(count), 0.4
    while t < seconds:
        length = float(rng.uniform(0.6, 2.5))
        moved = rng.choice(count, size=min(count, int(rng.integers(1, 3))), replace=False)
        window = (times >= t) & (times < t + length)
        for joint in moved:
            way = speed[joint] * rng.uniform(0.2, 0.8) * rng.choice([-1.0, 1.0]) * length
            if abs(position[joint] + way) > reach[joint]:
                way = -way
            way = float(np.clip(position[joint] + way, -reach[joint], reach[joint]) - position[joint])
            command[window, joint] = way / length
            position[joint] += way
        t += length + float(rng.choice([0.0, rng.uniform(0.1, 1.0)]))
    for width in (0.2, 0.12, 0.08):  # an unsteady hand and a ramp in the controller
        command = uniform_filter1d(command, int(width / STEP), axis=0, mode="nearest")
    wobble = rng.normal(size=command.shape)
    for width in (401, 301, 201):
        wobble = uniform_filter1d(wobble, width, axis=0, mode="wrap")
    return _centred(np.array(robot.home), command * (1 + 0.15 * wobble / wobble.std(axis=0)))


MOTIONS: dict[str, Callable[[Robot, float, np.random.Generator], Reference]] = {
    "trapezoidal": trapezoidal,
    "multi_sine": multi_sine,
    "pick_and_place": pick_and_place,
    "jogging": jogging,
}


def drive(seconds: float, rng: np.random.Generator) -> Reference:
    """The base's x, y (m) and yaw (rad): short drives with constant acceleration, pauses of 0.3 to 3 s."""
    home = np.zeros(3)
    speed = np.array([0.5, 0.4, 0.5])
    return _sequence(home, lambda _: rng.uniform(-1, 1, 3) * [1.2, 0.8, 1.2], speed, (0.3, 3.0), 0.5, seconds, rng)


def _sequence(
    start: Array,
    following: Callable[[Array], Array],
    speed: Array,
    pause: tuple[float, float],
    ramp: float,
    seconds: float,
    rng: np.random.Generator,
) -> Reference:
    """Straight moves in joint space; the share `ramp` of each is acceleration and braking, with rounded corners."""
    v, position, t = np.zeros((len(_times(seconds)), len(start))), start, 0.3
    while t < seconds:
        target = np.asarray(following(position), dtype=np.float64)
        brisk = float(rng.uniform(0.5, 1.0))
        share = ramp / 2
        length = float(np.max(np.abs(target - position) / (speed * brisk)) / (1 - share)) + 0.3
        first, last = int(t / STEP), int((t + length) / STEP)
        phase = (np.arange(first, last) * STEP - t) / length
        shape = np.minimum(np.minimum(phase, 1 - phase) / share, 1.0).clip(0) / (1 - share) / length
        room = len(v) - first
        v[first:last] += ((target - position) * shape[:, None])[:room]
        position, t = target, t + length + float(rng.uniform(*pause))
    v = uniform_filter1d(uniform_filter1d(v, 41, axis=0, mode="nearest"), 21, axis=0, mode="nearest")
    return _centred(start, v, centre=False)


def _centred(home: Array, v: Array, centre: bool = True) -> Reference:
    """Position and acceleration of a velocity (N, J), about a middle or from a start."""
    times = np.arange(len(v)) * STEP
    course = CubicSpline(times, v, axis=0)
    q = np.asarray(course.antiderivative()(times))
    middle = (q.max(0) + q.min(0)) / 2 if centre else 0.0
    return np.asarray(home + q - middle), np.asarray(course(times)), np.asarray(course(times, 1))


def _times(seconds: float) -> Array:
    return np.arange(round(seconds / STEP) + 1, dtype=np.float64) * STEP
