"""Truth for benchmarks/robustness.py without poise's models: brute statics of the three scenes of Table 4.1.

Every interface is a rectangle that carries one wrench: the centre of pressure lies in it, and friction is what uniform
pressure about that centre resists (a dense quadrature, many motions). Where balance leaves a choice (the table), the
wrenches that bear most are searched for by SLSQP from several starts.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from scipy.optimize import linprog, minimize

from poise.types import Array

STEPS = 200
HALVINGS = 50
SIDES = 32
LARGEST = 1e4
"""N; what bears this bears all."""


@dataclass(frozen=True)
class Rectangle:
    """An interface: between two bodies (-1: the floor), the second above, horizontal, sides along x and y.

    Args:
        bodies: below and above.
        centre: (3,) m.
        half: half sides, m.
    """

    bodies: tuple[int, int]
    centre: tuple[float, float, float]
    half: tuple[float, float]

    @cached_property
    def radius(self) -> float:
        """Mean distance from the centre, m."""
        return float(np.linalg.norm(self._grid, axis=1).mean())

    @cached_property
    def _grid(self) -> Array:
        x, y = np.meshgrid(*(half * (np.arange(40) + 0.5) / 20 - half for half in self.half))
        return np.stack([x.ravel(), y.ravel()], axis=1)

    @cached_property
    def motions(self) -> Array:
        """(M, 3) motions (vx, vy, turning times radius) that friction of 1 N resists with 1 W."""
        turn, lift = np.meshgrid(2 * np.pi * np.arange(48) / 48, np.linspace(-np.pi / 2, np.pi / 2, 33))
        ways = np.stack([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)], axis=-1).reshape(
            -1, 3
        )
        spin = ways[:, 2:] / self.radius
        speed = np.hypot(ways[:, :1] - spin * self._grid[:, 1], ways[:, 1:2] + spin * self._grid[:, 0]).mean(axis=1)
        return np.asarray(ways / speed[:, None])

    def wanting(self, wrench: Array, friction: float) -> Array:
        """(..., 5) what the rectangle lacks to carry a wrench (..., 6) about its centre; carried when none is positive.

        N m of pressure beyond each side, and N of friction.
        """
        fx, fy, normal, mx, my, mz = np.moveaxis(wrench, -1, 0)
        pressed = np.maximum(normal, 1e-9)
        x, y = -my / pressed, mx / pressed
        about = mz - (x * fy - y * fx)
        needed = (np.stack([fx, fy, about / self.radius], axis=-1) @ self.motions.T).max(axis=-1)
        sides = [-my - self.half[0] * normal, my - self.half[0] * normal]
        sides += [mx - self.half[1] * normal, -mx - self.half[1] * normal]
        return np.stack([*sides, needed - friction * normal], axis=-1)


@dataclass(frozen=True)
class Scene:
    """Bodies of 1 kg each on horizontal rectangles.

    Args:
        centres: (B, 3) of mass, m.
        rectangles: interfaces; in a stack the one below each body, in order.
        friction: coefficient of all.
        gravity: m/s2.
    """

    centres: Array
    rectangles: tuple[Rectangle, ...]
    friction: float = 0.5
    gravity: float = 9.81

    def robustness(self, body: int, point: Array, direction: Array) -> float:
        """N that a push may have; inf when it may exceed `LARGEST`."""
        if len(self.rectangles) == len(self.centres):
            return self._of_a_stack(body, point, direction)
        return self._searched(body, point, direction)

    def _of_a_stack(self, body: int, point: Array, direction: Array) -> float:
        """Every interface under the pushed body carries all above it: its wrench is known."""
        first = np.inf
        for number, rectangle in enumerate(self.rectangles[: body + 1]):
            arm = np.asarray(rectangle.centre)
            rest = sum(_wrench(np.array([0, 0, -self.gravity]), centre - arm) for centre in self.centres[number:])
            push = _wrench(direction, point - arm)
            steps = np.append(0.0, np.geomspace(1e-2, LARGEST, STEPS))
            over = rectangle.wanting(-rest - steps[:, None] * push, self.friction).max(axis=1) > 1e-9
            if not over.any():
                continue
            low, high = steps[over.argmax() - 1], steps[over.argmax()]
            for _ in range(HALVINGS):
                middle = (low + high) / 2
                gives = rectangle.wanting(-rest - middle * push, self.friction).max() > 1e-9
                low, high = (low, middle) if gives else (middle, high)
            first = min(first, low)
        return first

    def _balance(self, body: int, point: Array, direction: Array) -> tuple[Array, Array]:
        """Rows A (6 B, 6 I + 1) and right side of A x = b for interface wrenches on the upper body, and the push."""
        rows = np.zeros((len(self.centres), 6, 6 * len(self.rectangles) + 1))
        for i, rectangle in enumerate(self.rectangles):
            move = np.eye(6)
            x, y, z = rectangle.centre
            move[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
            for sign, end in zip((-1.0, 1.0), rectangle.bodies, strict=True):
                if end >= 0:
                    rows[end, :, 6 * i : 6 * i + 6] = sign * move
        rows[body, :, -1] = _wrench(direction, point)
        weights = [_wrench(np.array([0, 0, -self.gravity]), centre) for centre in self.centres]
        return rows.reshape(-1, rows.shape[2]), -np.concatenate(weights)

    def _searched(self, body: int, point: Array, direction: Array) -> float:
        """The most that any interface wrenches in balance bear: SLSQP in what balance leaves free."""
        rows, right = self._balance(body, point, direction)
        start, unbounded = self._by_corner_forces(rows, right)
        if unbounded:
            return np.inf
        free = np.linalg.svd(rows)[2][np.linalg.matrix_rank(rows) :].T

        def lacks(y: Array, origin: Array) -> Array:
            wrenches = (origin + free @ y)[:-1].reshape(-1, 6)
            pairs = zip(self.rectangles, wrenches, strict=True)
            return -np.concatenate([rectangle.wanting(wrench, self.friction) for rectangle, wrench in pairs])

        best = 0.0
        resting = np.linalg.lstsq(rows[:, :-1], right, rcond=None)[0]
        for origin in (start, np.append(resting, 0.0), (start + np.append(resting, 0.0)) / 2):
            found = minimize(
                lambda y, origin=origin: -float(origin[-1] + free[-1] @ y) / self.gravity,
                np.zeros(free.shape[1]),
                method="SLSQP",
                constraints={"type": "ineq", "fun": lacks, "args": (origin,)},
                options={"maxiter": 200, "ftol": 1e-8},
            )
            if lacks(found.x, origin).min() > -1e-4:
                best = max(best, -found.fun * self.gravity)
        return best

    def _by_corner_forces(self, rows: Array, right: Array) -> tuple[Array, bool]:
        """Interface wrenches and push that bear most if any forces may act at corners, and whether without end."""
        columns = []
        for i, rectangle in enumerate(self.rectangles):
            for x, y in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
                at = np.array([x * rectangle.half[0], y * rectangle.half[1], 0.0])
                for k in range(SIDES):
                    angle = 2 * np.pi * k / SIDES
                    force = np.array([self.friction * np.cos(angle), self.friction * np.sin(angle), 1.0])
                    column = np.zeros(rows.shape[1])
                    column[6 * i : 6 * i + 6] = _wrench(force, at)
                    columns.append(column)
        columns.append(np.eye(rows.shape[1])[-1])
        span = np.array(columns).T
        cost = np.append(np.zeros(len(columns) - 1), -1.0)
        bounds = [(0, None)] * (len(columns) - 1) + [(0, LARGEST)]
        found = linprog(cost, A_eq=rows @ span, b_eq=right, bounds=bounds, method="highs")
        return span @ found.x, bool(-found.fun > 0.99 * LARGEST)


def _wrench(force: Array, at: Array) -> Array:
    return np.concatenate([force, np.cross(at, force)])


FLOOR = -1
SCENES = {
    "cube": Scene(np.array([[0, 0, 0.5]]), (Rectangle((FLOOR, 0), (0, 0, 0), (0.5, 0.5)),)),
    "stack3": Scene(
        np.array([[0, 0, 0.5], [0, 0, 1.5], [0, 0, 2.5]]),
        tuple(Rectangle((i - 1, i), (0, 0, float(i)), (0.5, 0.5)) for i in range(3)),
    ),
    "table": Scene(
        np.array([[-0.9, 0, 0.5], [0.9, 0, 0.5], [0, 0, 1.1]]),
        tuple(
            Rectangle(bodies, (x, 0, z), (0.1, 0.5))
            for bodies, x, z in (((FLOOR, 0), -0.9, 0), ((FLOOR, 1), 0.9, 0), ((0, 2), -0.9, 1), ((1, 2), 0.9, 1))
        ),
    ),
}
