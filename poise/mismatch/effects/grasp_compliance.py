"""Grasp compliance: the whole payload rotates slightly in the grip, about a point on the sensor's z axis.

Suction cups and soft hands give about all axes; two fingers give about the line between their pads alone.
"""

from collections.abc import Iterable
from functools import partial
from itertools import product
from typing import ClassVar

import numpy as np

from poise.geometry import cross
from poise.inertia.model import symmetric
from poise.kernels import COMPILED, turned_in_grip, turned_load
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import Oscillator, transition
from poise.mismatch.effects.part_wrench import (
    AXIS_PARAMETERS,
    PAIRS,
    beside_errors,
    by_axis,
    chart,
    coarsely,
    damping_parameter,
    direction,
    named_axis,
    specific_at,
)
from poise.mismatch.recorded import RecordedMotion, smoothing
from poise.types import Array

_MOST_ROUNDS = 8
_SETTLED = 2e-5
"""rad, the change of the payload's rotation at which the iteration ends."""
_LARGEST = 0.5
"""rad, the largest rotation that is simulated."""
_BEYOND = 1e6
"""N and N m, the largest response."""
_SMALL = 1e-5
"""rad, rad/s and rad/s2 of derivatives by differences."""
_STARTING = 0.02
"""s between the samples from which a search begins."""
_SOFTEST, _STIFFEST = 5.0, 5000.0
"""N m/rad of a grip."""
_STIFFNESSES = tuple(np.geomspace(8.0, 1000.0, 11).tolist())
"""N m/rad from which the search may begin, with some damping that makes their resonances overlap."""
_HEIGHTS, _DAMPING_RATIO = (0.0, 0.05), 0.35
_FREQUENCIES, _RINGING = tuple(np.geomspace(1.5, 14.0, 9).tolist()), 0.1
"""Hz and damping ratio from which the search for a hinge may begin."""
_ONE, _ALL = 1.0, 3.0
"""Axes about which a grip gives."""
_CHART = np.linspace(-1.4, 1.4, 15).tolist()
_AXES = np.array([direction({"axis_a": a, "axis_b": b}) for a in _CHART for b in _CHART if a * a + b * b <= 2.0])
"""(K, 3) axes of hinges that are tried, evenly over half a sphere."""
_SCALE = 1.5
"""Largest scale of a response that is compared: stiffness, damping and height all change its size."""
_SMOOTHING = (0.03, 0.12)
"""s, widths of filters of the motion beside which the search begins."""


class GraspCompliance(Effect):
    """Springs and dampers, equal about all axes or about one alone, between sensor and payload; aligned without load.

    The turn theta (a rotation vector, sensor axes) obeys I theta'' + c theta' + k theta = torque of the turned and
    turning payload about the pivot, beyond -I theta''. In the principal axes of I these are three oscillators, of a
    hinge it is one; what the rotation itself does to the torque is taken from the previous iteration, to second order.
    """

    name = "grasp_compliance"
    layer = "load"
    equation = "I theta'' + c theta' + k theta = tau(theta, theta'), c = 2 zeta sqrt(k Ixx), or about one axis"
    source = "passive compliance of a grasp (Siciliano et al. 2009, section 9.2); Euler's equation about the pivot"
    excited_by = "weight to the side of the grip in changing directions; quick turns"
    separating_motion = "hold the payload level in four directions: it tilts in proportion to its moment"
    confused_with = ("flexible_mode", "payload_parameters", "joint_offset", "sensor_rotation", "sensor_gain")
    needs = ("load",)
    turn = "largest_turn"
    defaults: ClassVar[Values] = {"axes": _ALL, **dict.fromkeys(AXIS_PARAMETERS, 0.0)}

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("stiffness", "N m/rad", low=_SOFTEST, high=_STIFFEST, linear=False, log=True),
            damping_parameter(0.02, 1.5),
            EffectParameter("height", "m", low=-0.1, high=0.4, linear=False),
            EffectParameter("axes", "", low=_ONE, high=_ALL, linear=False, choice=True),
            *(EffectParameter(name, "", low=-1.9, high=1.9, linear=False, hidden=True) for name in AXIS_PARAMETERS),
        )

    def law(self, values: Values) -> str:
        return "hinge" if _hinged(values) else "equal about all axes"

    def inert(self, values: Values) -> tuple[str, ...]:
        return () if _hinged(values) else AXIS_PARAMETERS

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """Of each law the best, beside what errors of bias, gains and centre of mass explain."""
        recorded, residual = coarsely(recorded, residual, _STARTING)
        weight = np.repeat([1.0, 20.0], 3)
        straight = partial(_beside_smoothing, recorded)
        wanted, scores = straight(residual) * weight, []
        for height, stiffness in product(_HEIGHTS, _STIFFNESSES):
            values = {"stiffness": stiffness, "damping_ratio": _DAMPING_RATIO, "height": height}
            values |= self.defaults
            response = recorded.once(("grasp", height, stiffness), partial(self._simulated, recorded, values, rounds=1))
            scores.append((_left(wanted, straight(response) * weight), values))
        yield min(scores, key=lambda item: item[0])[1]
        hinges = product(_HEIGHTS, _FREQUENCIES)
        found = (_hinge(recorded, height, frequency, wanted, weight) for height, frequency in hinges)
        yield min(found, key=lambda item: item[0])[1]

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return self._simulated(recorded, values)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A pivot at the end of its range is in no gripper: the answer follows something else."""
        (height,) = (p for p in self.parameters(recorded) if p.name == "height")
        if height.at_end(values["height"]):
            return f"the grip would be {1e3 * values['height']:.0f} mm from the sensor"
        return super().implausible(recorded, values)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        turn = _Turned(recorded, values["height"]).turns(values)[0]
        axis = named_axis(values) if _hinged(values) else {}
        return {"largest_turn": (float(np.linalg.norm(turn, axis=1).max()), "rad"), **axis}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        turn = np.degrees(self.derived(recorded, values)["largest_turn"][0])
        x, y, z = direction(values)
        about = f"the axis ({x:.2f}, {y:.2f}, {z:.2f}) through " if _hinged(values) else ""
        return (
            f"The payload rotates in the grip, {values['stiffness']:.0f} N m/rad about {about}a point "
            f"{1e3 * values['height']:.0f} mm from the sensor, by up to {turn:.1f} degrees: the nominal grip is rigid."
        )

    @staticmethod
    def _simulated(recorded: RecordedMotion, values: Values, rounds: int = _MOST_ROUNDS) -> Array:
        body = _Turned(recorded, values["height"])
        found = body.reading(*body.turns(values, rounds)) - recorded.nominal
        # Rounds diverge where a payload is far too heavy for its springs: no reading is like that.
        return np.clip(np.nan_to_num(found, nan=_BEYOND), -_BEYOND, _BEYOND)


def _hinged(values: Values) -> bool:
    """Whether the grip gives about one axis alone."""
    return values.get("axes") == _ONE


def _left(wanted: Array, response: Array) -> float:
    """The sum of squares that a response, at most `_SCALE` times it, leaves."""
    scale = float(np.vdot(response, wanted)) / max(float(np.vdot(response, response)), 1e-12)
    return float(np.sum((wanted - min(max(scale, 0.0), _SCALE) * response) ** 2))


def _hinge(
    recorded: RecordedMotion, height: float, frequency: float, wanted: Array, weight: Array
) -> tuple[float, Values]:
    """The axis of a hinge of a frequency, Hz, and what it leaves: the response is linear in n n^T over n.I.n.

    Args:
        recorded: coarse.
        height: of the pivot on the sensor's z axis, m.
        frequency: natural, Hz.
        wanted: (N, 6) the residual, weighted, beside what errors explain.
        weight: (6,) of the channels.
    """
    body = _Turned(recorded, height)
    torque, by_turn = recorded.once(("hinge", height), body.linear)
    omega = 2.0 * np.pi * frequency
    z, dz = Oscillator(recorded.seconds, omega**2, 2.0 * _RINGING * omega)(torque)
    ddz = torque - 2.0 * _RINGING * omega * dz - omega**2 * z
    tensor = np.einsum("oanc,onb->ncab", by_turn, np.stack([z, dz, ddz]))
    entries = np.moveaxis(by_axis(tensor), 2, 0)
    columns = np.stack([(_beside_smoothing(recorded, entry) * weight).ravel() for entry in entries], axis=1)
    axes = _AXES / np.sqrt(np.maximum(np.einsum("ki,ij,kj->k", _AXES, body.inertia, _AXES), 1e-9))[:, None]
    squares = np.stack([axes[:, i] * axes[:, j] for i, j in PAIRS], axis=1)
    along = squares @ (columns.T @ wanted.ravel())
    size = np.einsum("ki,ij,kj->k", squares, columns.T @ columns, squares)
    scale = np.clip(along / np.maximum(size, 1e-12), 0.0, _SCALE)
    left = np.vdot(wanted, wanted) - scale * (2.0 * along - scale * size)
    # About an axis without inertia, no spring of this range is so slow.
    stiffness = omega**2 / np.einsum("ki,ki->k", axes, axes)
    left = np.where((stiffness > _SOFTEST) & (stiffness < _STIFFEST), left, np.inf)
    best = int(np.argmin(left))
    values = {
        "stiffness": float(np.clip(stiffness[best], _SOFTEST, _STIFFEST)),
        "damping_ratio": _RINGING,
        "height": height,
        "axes": _ONE,
    }
    return float(left[best]), values | chart(axes[best])


def _beside_smoothing(recorded: RecordedMotion, values: Array) -> Array:
    """(N, 6) wrenches without what errors of the motion and of bias, gains and centre of mass explain of each.

    The calibration smooths the predicted load, and so takes a part of the response of a spring out of a residual.
    """

    def made() -> Array:
        changes = beside_errors(recorded, smoothing(recorded.nominal, recorded.period, _SMOOTHING))
        return np.asarray(np.linalg.qr(changes.reshape(len(recorded), -1))[0])

    basis = recorded.once("smoothing", made)
    values = beside_errors(recorded, values)
    return np.asarray(values - basis @ (basis.T @ values))


class _Turned:
    """The payload about a pivot on the sensor's z axis."""

    def __init__(self, recorded: RecordedMotion, height: float) -> None:
        self._world, self._height = recorded, height
        pivot = np.array([0.0, 0.0, height])
        mass, first = float(recorded.phi[0]), recorded.phi[1:4]
        self._mass, self._moment = mass, first - mass * pivot
        self._specific = specific_at(recorded, pivot)
        # Inertia about the pivot from that about the origin: I - [p.h terms] + m [p.p terms] (parallel axes, twice).
        cross = np.outer(first, pivot)
        self.inertia = (
            symmetric(recorded.phi[4:])
            - (2.0 * np.trace(cross) * np.eye(3) - cross - cross.T)
            + mass * (pivot @ pivot * np.eye(3) - np.outer(pivot, pivot))
        )
        self._properties = np.concatenate([[self._mass], self._moment, self.inertia.ravel()])
        self._moved = np.stack([recorded.angular_velocity, recorded.angular_acceleration, self._specific])

    def wrench(self, turn: Array, rate: Array, second: Array) -> tuple[Array, Array]:
        """Force and torque about the pivot (N, 3) of the payload turned by rotation vectors, with their derivatives.

        In the payload's own axes it is a rigid body; omega_rel = theta' + theta x theta' / 2 to second order.
        """
        if COMPILED:
            both = turned_load(self._properties, self._moved, np.stack([turn, rate, second]))
            return both[:, :3], both[:, 3:]
        spin = rate + 0.5 * cross(turn, rate)
        change = second + 0.5 * cross(turn, second)
        omega = self._world.angular_velocity + spin
        alpha = self._world.angular_acceleration + change + cross(self._world.angular_velocity, spin)
        to = _Rotation(turn)
        moment = to(np.broadcast_to(self._moment, turn.shape))
        arm = cross(alpha, moment) + cross(omega, cross(omega, moment))
        own = to(to(omega, -1.0) @ self.inertia)
        gyro = to(to(alpha, -1.0) @ self.inertia) + cross(omega, own)
        return self._mass * self._specific - arm, cross(moment, self._specific) - gyro

    def turns(self, values: Values, rounds: int = _MOST_ROUNDS) -> tuple[Array, Array, Array]:
        """(N, 3) rotation vector of the payload in the sensor's axes, its rate and second rate."""
        moments, axes = np.linalg.eigh(self.inertia)
        moments = np.maximum(moments, 1e-3 * max(float(moments[-1]), 1e-6))
        typical = max(float(self.inertia[0, 0]), float(moments[0]))
        if _hinged(values):
            axes = direction(values)[:, None]
            typical = max(float(axes[:, 0] @ self.inertia @ axes[:, 0]), float(moments[0]))
            moments = np.array([typical])
        stiffness = values["stiffness"]
        damping = 2.0 * values["damping_ratio"] * np.sqrt(stiffness * typical)
        if not COMPILED:
            return self._turns(moments, axes, stiffness, damping, rounds)
        step = np.diff(self._world.seconds)
        each = moments[:, None]
        changes = np.moveaxis(transition(step, stiffness / each, damping / each), 2, 0)
        given = (self._properties, self._moved, step, changes, axes.T, moments)
        turn, rate, second = turned_in_grip(*given, (stiffness, damping), (rounds, _SETTLED, _LARGEST))
        return turn, rate, second

    def _turns(
        self, moments: Array, axes: Array, stiffness: float, damping: float, rounds: int
    ) -> tuple[Array, Array, Array]:
        """The same in Python, on springs about axes (3, S) with moments of inertia (S,)."""
        springs = [Oscillator(self._world.seconds, stiffness / m, damping / m) for m in moments.tolist()]
        turn, rate, second = np.zeros((3, len(self._world), 3))
        for _ in range(rounds):
            # The damper feels omega_rel; what of it is not theta' is of second order.
            felt = self.wrench(turn, rate, second)[1] - 0.5 * damping * cross(turn, rate)
            load = (felt + second @ self.inertia) @ axes / moments
            parts = [spring(load[:, i : i + 1]) for i, spring in enumerate(springs)]
            x, dx = (np.hstack([part[order] for part in parts]) for order in range(2))
            ddx = load - (damping * dx + stiffness * x) / moments
            new, rate, second = x @ axes.T, dx @ axes.T, ddx @ axes.T
            new *= np.minimum(1.0, _LARGEST / np.maximum(np.linalg.norm(new, axis=1, keepdims=True), 1e-9))
            moved = float(np.abs(new - turn).max())
            turn = new
            if moved < _SETTLED:
                break
        return turn, rate, second

    def reading(self, turn: Array, rate: Array, second: Array) -> Array:
        """(N, 6) wrench about the sensor's origin, see `wrench`."""
        force, torque = self.wrench(turn, rate, second)
        return np.concatenate([force, torque + cross(np.array([0.0, 0.0, self._height]), force)], axis=1)

    def linear(self) -> tuple[Array, Array]:
        """Of small turns: (N, 3) the torque about the pivot without one, and (3, 3, N, 6) the derivatives of `reading`.

        By the turn, its rate and its second rate, about each axis.
        """
        none = np.zeros((3, len(self._world), 3))
        straight, found = self.reading(*none), []
        for order, axis in product(range(3), range(3)):
            turned = none.copy()
            turned[order, :, axis] = _SMALL
            found.append((self.reading(*turned) - straight) / _SMALL)
        return self.wrench(*none)[1], np.stack(found).reshape(3, 3, *straight.shape)


class _Rotation:
    """Turns vectors (N, 3) by rotation vectors (N, 3), or back (sign -1): Rodrigues' formula."""

    def __init__(self, turn: Array) -> None:
        self._turn = turn
        angle = np.linalg.norm(turn, axis=1, keepdims=True)
        self._sine = np.sinc(angle / np.pi)
        self._versine = 0.5 * np.sinc(angle / (2.0 * np.pi)) ** 2

    def __call__(self, vectors: Array, sign: float = 1.0) -> Array:
        once = cross(self._turn, vectors)
        return np.asarray(vectors + sign * self._sine * once + self._versine * cross(self._turn, once))
