"""Physics outside the library: a wrench that depends smoothly on some state, for any reason.

Each state gives a pseudo-effect that competes with the named ones by its evidence: six free curves over the state.
Where one of them wins, the answer is `unknown`, with the state and the shape of the curve.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial

import numpy as np

from poise.geometry import cross
from poise.mismatch.effects import Effect, EffectParameter, Values
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion, noise_level
from poise.types import Array

_CURVE = 8
"""Linear B-splines over the range of a scalar state."""
_TURNS = 24
"""Linear B-splines over a joint's angle: mechanical and magnetic effects repeat several times per revolution."""
_TIME_STEP, _MOMENT = 4.0, 1.0
"""s between the knots of a slow curve in time, and of external pushes."""
_MOST_KNOTS = 48
"""Knots of a curve in time at most: its cost grows with their square, and would with the square of the duration."""
_PLACES = 10
"""Places along the path that carry a force which depends on the place."""
_TYPICAL = 3.0
"""Typical size of a curve, in units of the white noise."""
_LEVER = 0.1
"""m, typical lever arm of an external push."""
_SLOW = 0.02
"""m/s, the width of the transition of dry friction."""


@dataclass(frozen=True, eq=False)
class VaryingState:
    """A state that a residual may depend on.

    Args:
        name: as in the answer: gravity_direction, joint_position, joint_velocity, joint_acceleration (each also with
            :NAME), base_acceleration, load or time.
        values: (N, d) of the state itself, for drawing.
        columns: (N, 6, k) its wrenches, each with a size of about one unit of white noise.
    """

    name: str
    values: Array
    columns: Array


def states(recorded: RecordedMotion, level: Array) -> dict[str, Callable[[], VaryingState]]:
    """The states of this recording that vary; each is computed on demand.

    Args:
        recorded: the recording.
        level: (6,) white noise of a sample.
    """
    found: dict[str, Callable[[], VaryingState]] = {
        "time": partial(_of_time, recorded, level),
        "time:pushes": partial(_of_time_and_attitude, recorded, level),
        "time:load": partial(_of_time_and_load, recorded, level),
    }
    if float(np.abs(recorded.angular_velocity).max()) > 0.1:
        found["time:turning"] = partial(_of_time_and_turning, recorded, level)
    down = recorded.gravity / np.linalg.norm(recorded.gravity, axis=1, keepdims=True)
    if float(np.ptp(down, axis=0).max()) > 0.1:
        found["gravity_direction"] = lambda: VaryingState("gravity_direction", down, _each(harmonics(down), level))
    if float(np.ptp(recorded.nominal[:, :3], axis=0).max()) > 0.5:
        size = np.linalg.norm(recorded.nominal[:, :3], axis=1)[:, None]
        found["load"] = lambda: VaryingState("load", size, _own(recorded.nominal, level))
    if recorded.joints is not None:
        for kind in ("position", "velocity", "acceleration"):
            for j, name in enumerate(recorded.joints.names):
                values = getattr(recorded.joints, kind)[:, j]
                if float(np.ptp(values)) > 0.05:
                    found[f"joint_{kind}:{name}"] = partial(_of_joint, f"joint_{kind}:{name}", values, level)
    if float(np.abs(recorded.velocity_in_world).max()) > 0.05:
        found["joint_velocity"] = partial(_of_speed, recorded, level)
        found["joint_position"] = lambda: VaryingState(
            "joint_position", recorded.position_in_world, _anywhere(recorded, level)
        )
    if recorded.base is not None:
        turn = recorded.base.rotation_world_base
        felt = np.einsum("nji,nj->ni", turn, recorded.base.acceleration_in_world)
        if float(np.ptp(felt, axis=0).max()) > 0.05:
            turned = recorded.base.angular_acceleration_in_base[:, 2:]
            found["base_acceleration"] = partial(_of_base, felt, turned, level)
    return found


def _course(recorded: RecordedMotion, step: float) -> Array:
    return linear_bspline_basis(recorded.seconds, min(max(int(recorded.duration / step), 4), _MOST_KNOTS))


def _of_time(recorded: RecordedMotion, level: Array) -> VaryingState:
    return VaryingState("time", recorded.seconds[:, None], _each(_course(recorded, _TIME_STEP), level))


def _of_time_and_attitude(recorded: RecordedMotion, level: Array) -> VaryingState:
    """Forces and torques in world axes, faster than `_of_time`: external forces do not rotate with the tool."""
    course, turn = _course(recorded, _MOMENT), recorded.rotation_world_sensor.swapaxes(1, 2)
    half = (turn[:, :, None, :] * course[:, None, :, None]).reshape(len(recorded), 3, -1)
    out = np.zeros((len(recorded), 6, 2 * half.shape[2]))
    out[:, :3, : half.shape[2]], out[:, 3:, half.shape[2] :] = half * level[0], half * level[3]
    return VaryingState("time", recorded.seconds[:, None], out)


def _of_time_and_load(recorded: RecordedMotion, level: Array) -> VaryingState:
    """A gain of each channel that changes with time."""
    # Each knot has 36 columns.
    course = _course(recorded, max(_TIME_STEP, recorded.duration / 10))
    felt = recorded.nominal / np.maximum(np.sqrt(np.mean(recorded.nominal**2, axis=0)), 1e-9)
    columns = _each(course, level).reshape(len(recorded), 6, 6, -1) * felt[:, :, None, None]
    return VaryingState("time", recorded.seconds[:, None], columns.reshape(len(recorded), 6, -1))


def _of_time_and_turning(recorded: RecordedMotion, level: Array) -> VaryingState:
    """Torques that grow with the angular velocity by a factor that changes with time: a rotor that spins up."""
    course = _course(recorded, _TIME_STEP)
    rate = recorded.angular_velocity / max(float(recorded.angular_velocity.std()), 1e-9)
    turned = np.stack([cross(rate, np.broadcast_to(axis, rate.shape)) for axis in np.eye(3)], axis=2)
    out = np.zeros((len(recorded), 6, 3 * (course.shape[1] + 1)))
    out[:, 3:, 3:] = (turned[:, :, None, :] * course[:, None, :, None]).reshape(len(recorded), 3, -1) * level[5]
    # A changing angular momentum also acts by its rate, for any rotation of the tool.
    out[:, 3:, :3] = np.eye(3) * level[5]
    return VaryingState("time", recorded.seconds[:, None], out)


def _of_joint(name: str, values: Array, level: Array) -> VaryingState:
    turns = min(max(_CURVE, round(_TURNS * float(np.ptp(values)) / np.pi)), 2 * _TURNS)
    count = turns if name.startswith("joint_position") else _CURVE
    return VaryingState(name, values[:, None], _each(linear_bspline_basis(values, count), level))


def _of_speed(recorded: RecordedMotion, level: Array) -> VaryingState:
    speed = np.linalg.norm(recorded.velocity_in_world, axis=1, keepdims=True)
    laws = np.hstack([recorded.velocity_in_world / np.sqrt(speed**2 + _SLOW**2), recorded.velocity_in_world])
    return VaryingState("joint_velocity", speed, _pushes(recorded, laws.reshape(-1, 2, 3), level))


def _of_base(felt: Array, turned: Array, level: Array) -> VaryingState:
    curves = np.hstack([linear_bspline_basis(felt[:, k], 5) for k in (0, 1)])
    return VaryingState("base_acceleration", felt, _each(np.hstack([curves, turned]), level))


def _each(basis: Array, level: Array) -> Array:
    """(N, 6, 6 b): every function (N, b) in every channel."""
    n, count = basis.shape
    out = np.zeros((n, 6, 6 * count))
    for channel in range(6):
        out[:, channel, channel * count : (channel + 1) * count] = basis * level[channel]
    return out


def _own(wrench: Array, level: Array) -> Array:
    """(N, 6, 6 b): in every channel functions of the load of that channel."""
    curves = [linear_bspline_basis(wrench[:, channel], _CURVE) for channel in range(6)]
    out = np.zeros((len(wrench), 6, 6 * _CURVE))
    for channel, basis in enumerate(curves):
        out[:, channel, channel * _CURVE : (channel + 1) * _CURVE] = basis * level[channel]
    return out


def _pushes(recorded: RecordedMotion, forces_in_world: Array, level: Array) -> Array:
    """(N, 6, 4 k) wrenches of forces (N, k, 3) in the world that act anywhere on the tool, or at its origin."""
    force = np.einsum("nji,nkj->nki", recorded.rotation_world_sensor, forces_in_world)
    at_origin = np.concatenate([force, np.zeros_like(force)], axis=2)
    levers = [
        np.concatenate([np.zeros_like(force), cross(np.broadcast_to(arm * _LEVER, force.shape), force)], axis=2)
        for arm in np.eye(3)
    ]
    return np.asarray(np.concatenate([at_origin, *levers], axis=1).swapaxes(1, 2) * level[0])


def _anywhere(recorded: RecordedMotion, level: Array) -> Array:
    """(N, 6, k) forces in the world that depend on where the sensor is: Gaussian bumps around places of the path."""
    place = recorded.position_in_world
    # Places far from one another: each is the farthest from those before.
    chosen = [int(np.argmax(np.linalg.norm(place - place.mean(axis=0), axis=1)))]
    apart = np.linalg.norm(place - place[chosen[0]], axis=1)
    while len(chosen) < _PLACES:
        chosen.append(int(np.argmax(apart)))
        apart = np.minimum(apart, np.linalg.norm(place - place[chosen[-1]], axis=1))
    width = max(float(apart.max()), 0.05)
    away = np.linalg.norm(place[:, None] - place[chosen], axis=2)
    bumps = np.exp(-0.5 * (away / width) ** 2)
    forces = (bumps[:, :, None, None] * np.eye(3)).reshape(len(place), -1, 3)
    return _pushes(recorded, forces, level)


def linear_bspline_basis(values: Array, count: int) -> Array:
    """(N, count) piecewise linear functions with knots spread over the range, narrower where values are many."""
    even = np.linspace(values.min(), values.max(), count)
    often = np.quantile(values, np.linspace(0.0, 1.0, count))
    knots = (even + often) / 2
    knots = np.maximum.accumulate(knots + np.arange(count) * 1e-9 * (np.ptp(values) + 1e-9))
    out = np.empty((len(values), count))
    for k, unit in enumerate(np.eye(count)):
        out[:, k] = np.interp(values, knots, unit)
    return out


def harmonics(direction: Array) -> Array:
    """(N, 15) polynomials on the sphere of degree one to three, the spherical harmonics of these degrees."""
    x, y, z = direction.T
    first = [x, y, z]
    second = [x * y, y * z, z * x, x * x - y * y, 3 * z * z - 1]
    third = [
        x * (5 * z * z - 1),
        y * (5 * z * z - 1),
        z * (5 * z * z - 3),
        x * y * z,
        z * (x * x - y * y),
        x * (x * x - 3 * y * y),
        y * (3 * x * x - y * y),
    ]
    return np.stack(first + second + third, axis=1)


@cache
def coefficients(count: int) -> tuple[EffectParameter, ...]:
    return tuple(EffectParameter(f"c{k}", "", _TYPICAL, hidden=True) for k in range(count))


class FreeCurve(Effect):
    """A signal has a part that is some function of one state: physics that is not in the library."""

    order = 9
    lasting = True
    source = "piecewise linear regression with a normal prior (a Gaussian process with a linear B-spline kernel)"
    excited_by = "the state"
    separating_motion = "vary this state alone, the others held still"
    state: str

    @property
    def of_time(self) -> bool:
        """Whether the state is the time, which does not return."""
        return self.state.startswith("time")


class Dependence(FreeCurve):
    """The wrench has a part that is some function of one state.

    Args:
        state: its name, see `states`.
    """

    layer = "sensor"
    equation = "w_read = w + c(s), c: six free curves over the state s"

    def __init__(self, state: str) -> None:
        self.state = "time" if state.startswith("time") else state
        self._kind = state
        self.name = f"unknown:{state}"  # type: ignore[misc]
        self._known: list[tuple[Array, VaryingState | None]] = []

    def at(self, recorded: RecordedMotion) -> VaryingState | None:
        """The state in a recording, cached for all models; None when it does not vary."""
        for seconds, state in self._known:
            if seconds is recorded.seconds or np.array_equal(seconds, recorded.seconds):
                return state
        made = states(recorded, _level(recorded)).get(self._kind)
        found = None if made is None else made()
        self._known = [*self._known[-2:], (recorded.seconds, found)]
        return found

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        state = self.at(recorded)
        count = 0 if state is None else state.columns.shape[2]
        return coefficients(count)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        del nonlinear
        state = self.at(recorded)
        return np.zeros((len(recorded), 6, 0)) if state is None else state.columns

    def untestable(self, recorded: RecordedMotion) -> str:
        return "" if self.at(recorded) is not None else "the state does not vary"

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        response = self.simulate(recorded, values)
        size = response.std(axis=0) / _level(recorded)
        channel = int(np.argmax(size))
        unit = "N" if channel < 3 else "N m"
        return (
            f"An effect outside the library adds up to {np.abs(response[:, channel]).max():.2g} {unit} to "
            f"{WRENCH_CHANNELS[channel]} and depends on {state_description(self.state)}."
        )


@dataclass(frozen=True, eq=False)
class DependenceCurve:
    """The curve of an unknown dependence, for drawing: one scalar of the state against the channel it moves most."""

    state: str
    channel: str
    unit: str
    values: Array
    response: Array


def dependence_curve(
    effect: Dependence, recorded: RecordedMotion, values: Values, points: int = 60
) -> DependenceCurve | None:
    """Means of the response over the state's range, for the component of the state that it follows most."""
    state = effect.at(recorded)
    if state is None:
        return None
    response = effect.simulate(recorded, values)
    channel = int(np.argmax(response.std(axis=0) / _level(recorded)))
    course = response[:, channel]
    spread = [_spread(component, course) for component in state.values.T]
    component = state.values[:, int(np.argmin(spread))]
    order = np.argsort(component)
    parts = np.array_split(order, min(points, len(order)))
    return DependenceCurve(
        effect.state,
        WRENCH_CHANNELS[channel],
        "N" if channel < 3 else "N m",
        np.array([component[part].mean() for part in parts]),
        np.array([course[part].mean() for part in parts]),
    )


def _level(recorded: RecordedMotion) -> Array:
    """(6,) noise of a sample of the wrench; that of an FT-300 in a simulated motion."""
    if not np.isfinite(recorded.wrench).all():
        return np.repeat([0.1, 0.005], 3)
    found = noise_level(recorded.wrench - recorded.nominal, recorded.period)
    return np.asarray(np.maximum(np.sqrt(found.share) * found.sigma, 1e-9))


def dependences(recorded: RecordedMotion) -> list[Effect]:
    """A pseudo-effect for every state that varies."""
    return [Dependence(name) for name in states(recorded, _level(recorded))]


def state_description(state: str) -> str:
    """A state in words."""
    kind, _, joint = state.partition(":")
    words = {
        "gravity_direction": "the direction of gravity in the sensor",
        "joint_position": f"the angle of {joint}" if joint else "where the tool is",
        "joint_velocity": f"the speed of {joint}" if joint else "how fast the tool moves",
        "joint_acceleration": f"the acceleration of {joint}",
        "base_acceleration": "the acceleration of the base",
        "load": "the load on the sensor",
        "time": "the elapsed time",
    }
    return words.get(kind, state)


def _spread(component: Array, course: Array) -> float:
    """Scatter of a curve about its mean at equal values of a component."""
    order = np.argsort(component)
    parts = np.array_split(course[order], 20)
    return float(np.mean([part.var() for part in parts]))
