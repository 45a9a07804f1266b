"""Grasp compliance: the whole payload rotates slightly in the grip, about a point on the sensor's z axis."""

from collections.abc import Iterable
from functools import partial
from itertools import product

import numpy as np

from poise.geometry import cross
from poise.inertia.model import symmetric
from poise.mismatch.effects.base import Effect, EffectParameter, Values
from poise.mismatch.effects.part_motion import Oscillator
from poise.mismatch.effects.part_wrench import beside_errors, coarsely, specific_at
from poise.mismatch.recorded import RecordedMotion, smoothing
from poise.types import Array

_MOST_ROUNDS = 8
_SETTLED = 2e-5
"""rad, the change of the payload's rotation at which the iteration ends."""
_LARGEST = 0.5
"""rad, the largest rotation that is simulated."""
_STARTING = 0.02
"""s between the samples from which a search begins."""
_STIFFNESSES = tuple(np.geomspace(8.0, 1000.0, 11).tolist())
"""N m/rad from which the search may begin, with some damping that makes their resonances overlap."""
_HEIGHTS, _DAMPING_RATIO = (0.0, 0.05), 0.35
_SCALE = 1.5
"""Largest scale of a response that is compared: stiffness, damping and height all change its size."""
_SMOOTHING = (0.03, 0.12)
"""s, widths of filters of the motion beside which the search begins."""


class GraspCompliance(Effect):
    """Springs and dampers, equal about all axes, between sensor and payload; aligned without load.

    The turn theta (a rotation vector, sensor axes) obeys I theta'' + c theta' + k theta = torque of the turned and
    turning payload about the pivot, beyond -I theta''. In the principal axes of I these are three oscillators; what
    the rotation itself does to the torque is taken from the previous iteration, to second order.
    """

    name = "grasp_compliance"
    layer = "load"
    equation = "I theta'' + c theta' + k theta = tau(theta, theta'), c = 2 zeta sqrt(k Ixx); w of the turned payload"
    source = "passive compliance of a grasp (Siciliano et al. 2009, section 9.2); Euler's equation about the pivot"
    excited_by = "weight to the side of the grip in changing directions; quick turns"
    separating_motion = "hold the payload level in four directions: it tilts in proportion to its moment"
    confused_with = ("flexible_mode", "payload_parameters", "joint_offset", "sensor_rotation", "sensor_gain")
    needs = ("load",)
    turn = "largest_turn"

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        del recorded
        return (
            EffectParameter("stiffness", "N m/rad", low=5.0, high=5000.0, linear=False, log=True),
            EffectParameter("damping_ratio", "", low=0.02, high=1.5, linear=False, log=True),
            EffectParameter("height", "m", low=-0.1, high=0.4, linear=False),
        )

    def starts(self, recorded: RecordedMotion, residual: Array) -> Iterable[Values]:
        """The best of several stiffnesses and heights, beside what errors of bias, gains and centre of mass explain."""
        recorded, residual = coarsely(recorded, residual, _STARTING)
        weight = np.repeat([1.0, 20.0], 3)
        straight = partial(_beside_smoothing, recorded)
        wanted, scores = straight(residual) * weight, []
        for height, stiffness in product(_HEIGHTS, _STIFFNESSES):
            values = {"stiffness": stiffness, "damping_ratio": _DAMPING_RATIO, "height": height}
            response = recorded.once(("grasp", height, stiffness), partial(self._simulated, recorded, values, rounds=1))
            along = straight(response) * weight
            scale = np.vdot(along, wanted) / max(float(np.vdot(along, along)), 1e-12)
            scores.append((float(np.sum((wanted - min(max(scale, 0.0), _SCALE) * along) ** 2)), values))
        yield min(scores, key=lambda item: item[0])[1]

    def simulate(self, recorded: RecordedMotion, values: Values) -> Array:
        return self._simulated(recorded, values)

    def implausible(self, recorded: RecordedMotion, values: Values) -> str:
        """A pivot at the end of its range is in no gripper: the answer follows something else."""
        (height,) = (p for p in self.parameters(recorded) if p.name == "height")
        if height.at_end(values["height"]):
            return f"the grip would be {1e3 * values['height']:.0f} mm from the sensor"
        return super().implausible(recorded, values)

    def derived(self, recorded: RecordedMotion, values: Values) -> dict[str, tuple[float, str]]:
        turn = _turns(recorded, values)[0]
        return {"largest_turn": (float(np.linalg.norm(turn, axis=1).max()), "rad")}

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        turn = np.degrees(self.derived(recorded, values)["largest_turn"][0])
        return (
            f"The payload rotates in the grip, {values['stiffness']:.0f} N m/rad about a point "
            f"{1e3 * values['height']:.0f} mm from the sensor, by up to {turn:.1f} degrees: the nominal grip is rigid."
        )

    @staticmethod
    def _simulated(recorded: RecordedMotion, values: Values, rounds: int = _MOST_ROUNDS) -> Array:
        turn, rate, second = _turns(recorded, values, rounds)
        body = _Turned(recorded, values["height"])
        force, torque = body.wrench(turn, rate, second)
        pivot = np.array([0.0, 0.0, values["height"]])
        return np.concatenate([force, torque + cross(pivot, force)], axis=1) - recorded.nominal


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


def _turns(recorded: RecordedMotion, values: Values, rounds: int = _MOST_ROUNDS) -> tuple[Array, Array, Array]:
    """(N, 3) rotation vector of the payload in the sensor's axes, its rate and second rate."""
    body = _Turned(recorded, values["height"])
    moments, axes = np.linalg.eigh(body.inertia)
    moments = np.maximum(moments, 1e-3 * max(float(moments[-1]), 1e-6))
    stiffness = values["stiffness"]
    damping = 2.0 * values["damping_ratio"] * np.sqrt(stiffness * max(float(body.inertia[0, 0]), moments[0]))
    springs = [Oscillator(recorded.seconds, stiffness / m, damping / m) for m in moments.tolist()]
    turn, rate, second = np.zeros((3, len(recorded), 3))
    for _ in range(rounds):
        # The damper feels omega_rel; what of it is not theta' is of second order.
        felt = body.wrench(turn, rate, second)[1] - 0.5 * damping * cross(turn, rate)
        load = (felt + second @ body.inertia) @ axes / moments
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


class _Turned:
    """The payload about a pivot on the sensor's z axis."""

    def __init__(self, recorded: RecordedMotion, height: float) -> None:
        self._world = recorded
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

    def wrench(self, turn: Array, rate: Array, second: Array) -> tuple[Array, Array]:
        """Force and torque about the pivot (N, 3) of the payload turned by rotation vectors, with their derivatives.

        In the payload's own axes it is a rigid body; omega_rel = theta' + theta x theta' / 2 to second order.
        """
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
