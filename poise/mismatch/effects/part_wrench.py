"""The wrench on the sensor from parts that move within the payload, and from unreported motion of the robot."""

from collections.abc import Mapping
from functools import partial

import numpy as np
from numpy.typing import ArrayLike

from poise.geometry import applied, cross, cross_matrix
from poise.mismatch.effects.base import EffectParameter
from poise.mismatch.effects.part_motion import hanging
from poise.mismatch.effects.starts import noise_in
from poise.mismatch.recorded import RecordedMotion, shown
from poise.types import Array

POINT_PARAMETERS = ("x", "y", "z")
PAYLOAD_REACH = 0.5
"""m from the sensor within which parts of a payload are searched."""
_SWING_SAMPLES, _ENOUGH = 0.03, 500
"""s between the samples from which a search for pendulums begins, and how many there are at the least."""
_END = 0.98
"""Share of the reach from which a place is at the end of its range."""
_SHARE = 1.05
"""Largest mass of a moving part relative to the nominal payload, whose mass has a tolerance."""
PAIRS = tuple((i, j) for i in range(3) for j in range(i, 3))
"""Entries of a symmetric matrix (3, 3)."""
AT_PIVOT, NOWHERE, AT_REST = 0.0, 1.0, 2.0
"""Where the nominal model has a part that swings."""
AXIS_PARAMETERS = ("axis_a", "axis_b")
"""Chart of directions, see `direction`."""


def place_of(values: Mapping[str, float]) -> Array:
    """(3,) the point x, y, z, sensor axes."""
    return np.array([values[name] for name in POINT_PARAMETERS])


def specific_at(recorded: RecordedMotion, place: Array) -> Array:
    """(N, 3) m/s2, gravity minus acceleration of a point of the tool, sensor axes."""
    return np.asarray(recorded.specific - applied(lever_rates(recorded), place))


def lever_rates(recorded: RecordedMotion) -> Array:
    """(N, 3, 3) 1/s2, acceleration against the sensor's origin by the place: alpha x . + omega x (omega x .)."""

    def made() -> Array:
        turning = cross_matrix(recorded.angular_velocity)
        return np.ascontiguousarray(cross_matrix(recorded.angular_acceleration) + turning @ turning)

    return recorded.once("lever rates", made)


def point_wrench(recorded: RecordedMotion, place: Array) -> Array:
    """(N, 6) of a point mass of 1 kg that is fixed to the tool (thesis eq. 2.97)."""
    force = specific_at(recorded, place)
    return np.concatenate([force, cross(place, force)], axis=1)


def nominal_parameter() -> EffectParameter:
    """Where the nominal model has what swings: at its pivot, as static poses show it, nowhere, or where it rests."""
    return EffectParameter("nominal", "", low=AT_PIVOT, high=AT_REST, linear=False, choice=True, hidden=True)


def damping_parameter(low: float, high: float) -> EffectParameter:
    """The damping ratio of what swings, whose law is never quite viscous."""
    return EffectParameter("damping_ratio", "", low=low, high=high, linear=False, log=True, law_error=0.05)


def nominals(swing: Mapping[str, float]) -> list[dict[str, float]]:
    """Values of a swing with each place that the nominal model may give it."""
    return [{**swing, "nominal": place} for place in (AT_PIVOT, NOWHERE, AT_REST)]


def _nominal(values: Mapping[str, float]) -> float:
    """Where the nominal model has what swings; values of earlier versions have it at the pivot."""
    return values.get("nominal", AT_PIVOT)


def nominal_law(values: Mapping[str, float]) -> str:
    """The law of what swings, see `Effect.law`."""
    return f"nominal {_nominal(values):.0f}"


def nominal_said(values: Mapping[str, float]) -> str:
    """What the nominal model has in the place of what swings, as a clause."""
    lacking = _nominal(values) == NOWHERE
    return "the nominal payload lacks them" if lacking else "the nominal payload is rigid"


def beyond_nominal(recorded: RecordedMotion, values: Mapping[str, float], depth: float) -> Array:
    """(N, 6) what is added to the response of 1 kg that swings, which counts from this mass rigid at its pivot.

    Args:
        recorded: the recording.
        values: with `nominal` and the pivot.
        depth: m, how far below the pivot its centre rests.
    """
    known, pivot = _nominal(values), place_of(values)
    if known == AT_PIVOT:
        return np.zeros((len(recorded), 6))
    rigid = point_wrench(recorded, pivot)
    return rigid if known == NOWHERE else rigid - point_wrench(recorded, pivot + depth * _downwards(recorded))


def _downwards(recorded: RecordedMotion) -> Array:
    """(3,) the axis of the sensor along which its load hangs most of the time."""
    mean = recorded.gravity.mean(axis=0)
    largest = int(np.argmax(np.abs(mean)))
    return np.asarray(np.sign(mean[largest]) * np.eye(3)[largest])


def sliding_wrench(recorded: RecordedMotion, place: Array, axis: Array, slid: tuple[Array, Array, Array]) -> Array:
    """(N, 6) the difference between a part of 1 kg that slides along an axis and this mass fixed at `place`.

    Args:
        recorded: the recording.
        place: (3,) m, where the nominal model has it.
        axis: (3,) unit vector, fixed to the tool.
        slid: (N,) each: how far along the axis, m, its rate and second rate.
    """
    along, rate, second = (part[:, None] for part in slid)
    about = cross_matrix(axis)
    swept = along * applied(lever_rates(recorded), axis) + (2.0 * rate) * (recorded.angular_velocity @ about)
    beyond = axis * second + swept
    torque = (along * (specific_at(recorded, place) - beyond)) @ about.T - beyond @ cross_matrix(place).T
    return np.concatenate([-beyond, torque], axis=1)


def swinging_wrench(recorded: RecordedMotion, place: Array, length: float, damping_ratio: float) -> Array:
    """(N, 6) the difference between 1 kg on a spherical pendulum and this mass fixed at its pivot.

    Args:
        recorded: the recording.
        place: (3,) m, the pivot, sensor axes.
        length: m.
        damping_ratio: of small swings.
    """
    pull = recorded.to_world(specific_at(recorded, place)) / length
    rate = recorded.to_world(recorded.angular_velocity)
    frequency = swing_frequency(recorded, length)
    damping = 2.0 * damping_ratio * frequency
    u, du, ddu = hanging(recorded.seconds, pull, rate, frequency, damping)
    force = recorded.to_sensor(-length * ddu)
    # The damper in the pivot turns the tool the way the pendulum turns.
    twist = recorded.to_sensor(damping * length**2 * cross(u, du - cross(rate, u)))
    return np.concatenate([force, cross(place, force) + twist], axis=1)


def swing_frequency(recorded: RecordedMotion, length: float) -> float:
    """rad/s of small swings of a pendulum."""
    return float(np.sqrt(np.median(np.linalg.norm(recorded.gravity, axis=1)) / length))


def likely_swings(
    recorded: RecordedMotion, residual: Array, lengths: Array, damping_ratio: float, count: int
) -> list[dict[str, float]]:
    """Lengths (best first) and pivots, with a damping ratio, of pendulums whose swing fits a residual (N, 6)."""
    recorded, residual = coarsely(recorded, residual, _SWING_SAMPLES)
    wanted = beside_errors(recorded, residual)
    weight = 1.0 / noise_in(recorded, residual)
    place = payload_centre(recorded)
    found = []
    for length in lengths.tolist():
        swing = recorded.once(
            ("swing", length, damping_ratio), partial(_bare_swing, recorded, place, length, damping_ratio)
        )
        along, size = (float(np.sum(swing * other * weight**2)) for other in (wanted, swing))
        mass = along / max(size, 1e-12)
        pivot = likely_place(mass * swing[:, :3], wanted[:, 3:]) if mass > 0.0 else place
        values = {"length": length, "damping_ratio": damping_ratio}
        found.append((along * mass, values | dict(zip(POINT_PARAMETERS, pivot.tolist(), strict=True))))
    return [values for _, values in sorted(found, key=lambda item: -item[0])[:count]]


def _bare_swing(recorded: RecordedMotion, place: Array, length: float, damping_ratio: float) -> Array:
    return beside_errors(recorded, swinging_wrench(recorded, place, length, damping_ratio))


def coarsely(recorded: RecordedMotion, residual: Array, span: float) -> tuple[RecordedMotion, Array]:
    """The recording at the middles of groups of samples that span `span` s, and the means of a residual (N, C)."""
    length = 2 * int(0.5 * span / recorded.period) + 1
    count = len(recorded) // length
    if length == 1 or count < _ENOUGH:
        return recorded, residual
    rows = np.zeros(len(recorded), dtype=bool)
    rows[length // 2 : count * length : length] = True
    thin = recorded.once(("coarse", length), lambda: recorded.select(rows))
    return thin, residual[: count * length].reshape(count, length, -1).mean(axis=1)


def beside_errors(recorded: RecordedMotion, values: Array) -> Array:
    """(N, 6, ...) wrenches without what a bias, gains and a shifted centre of mass explain of each channel.

    Without a wrench sensor, only what the joint efforts show of wrenches remains: a residual holds nothing else.
    """
    return beside_states(error_states(recorded), shown(recorded, values))


def beside_states(states: Array, values: Array) -> Array:
    """(N, ...) channels without what orthonormal states (N, k) explain of each."""
    flat = values.reshape(len(values), -1)
    return np.asarray(flat - states @ (states.T @ flat)).reshape(values.shape)


def error_states(recorded: RecordedMotion) -> Array:
    """(N, 10) orthonormal: the states that errors of bias, gain and centre of mass depend on."""

    def made() -> Array:
        known = np.hstack([np.ones((len(recorded), 1)), recorded.specific, recorded.nominal])
        return np.asarray(np.linalg.qr(known / np.maximum(np.linalg.norm(known, axis=0), 1e-9))[0])

    return recorded.once("errors", made)


def no_part(recorded: RecordedMotion, values: Mapping[str, float], mass: float) -> str:
    """Why a part of the payload cannot have a mass, kg, and a place, as a clause; "" when it can."""
    whole = abs(float(recorded.phi[0]))
    most = _SHARE * whole if _nominal(values) != NOWHERE else whole
    heavy = f"{mass:.2f} kg would move in a payload of {whole:.2f} kg" if mass > most else ""
    return heavy or out_of_reach(values)


def out_of_reach(values: Mapping[str, float]) -> str:
    """Why nothing acts at a place, as a clause: a fit pressed it against the end of its range; "" otherwise."""
    farthest = float(np.abs(place_of(values)).max())
    return f"it would act {farthest:.2f} m from the sensor" if farthest > _END * PAYLOAD_REACH else ""


def spin_square(recorded: RecordedMotion, axis: Array) -> Array:
    """(N,) 1/s2, what drives a part outwards along an axis per metre: |omega|^2 - (omega . axis)^2."""
    rate = recorded.angular_velocity
    return np.asarray(np.einsum("ni,ni->n", rate, rate) - (rate @ axis) ** 2)


def shaking_columns(recorded: RecordedMotion, rotation_world_from: Array | None = None) -> Array:
    """(N, 6, 3) the payload's wrench under an acceleration (1 m/s2) that the nominal motion lacks.

    Args:
        recorded: the recording.
        rotation_world_from: (N, 3, 3) of the axes that it is given in; None: the world's.
    """
    turn = recorded.rotation_world_sensor.swapaxes(1, 2)
    turn = turn if rotation_world_from is None else turn @ rotation_world_from
    first = recorded.phi[1:4]
    return np.concatenate([-recorded.phi[0] * turn, -cross(first[None, :, None], turn, axis=1)], axis=1)


def shaking(recorded: RecordedMotion, residual: Array) -> Array:
    """(N, 3) m/s2 in world axes: the unreported acceleration that a residual force implies."""
    return recorded.to_world(residual[:, :3]) / -max(abs(float(recorded.phi[0])), 1e-3)


def direction(values: Mapping[str, float]) -> Array:
    """(3,) the unit vector of two numbers: Lambert's equal-area chart of the sphere, smooth but for -z.

    An axis and its opposite mean the same here; the half with z > 0 lies within a radius of sqrt(2).
    """
    a, b = values[AXIS_PARAMETERS[0]], values[AXIS_PARAMETERS[1]]
    square = min(a * a + b * b, 4.0)
    flat = np.sqrt(1.0 - square / 4.0)
    vector = np.array([a * flat, b * flat, 1.0 - square / 2.0])
    return np.asarray(vector / np.linalg.norm(vector))


def chart(axis: ArrayLike) -> dict[str, float]:
    """The two numbers of an axis (3,), from its half with z >= 0."""
    unit = np.asarray(axis, dtype=np.float64) / np.linalg.norm(axis)
    unit = -unit if unit[2] < 0.0 else unit
    size = np.sqrt(2.0 / (1.0 + unit[2]))
    return {AXIS_PARAMETERS[0]: float(unit[0] * size), AXIS_PARAMETERS[1]: float(unit[1] * size)}


def named_axis(values: Mapping[str, float]) -> dict[str, tuple[float, str]]:
    """The axis as its three components, for `Effect.derived`."""
    return {f"axis_{tag}": (float(value), "") for tag, value in zip("xyz", direction(values), strict=True)}


def likely_place(force: Array, torque: Array) -> Array:
    """(3,) the point p with torque = p x force, least squares, within reach.

    Args:
        force: (N, 3) N.
        torque: (N, 3) N m.
    """
    lever = np.stack([cross(unit, force) for unit in np.eye(3)], axis=2)
    normal = np.einsum("nci,ncj->ij", lever, lever)
    normal += (1e-3 * np.trace(normal) + 1e-12) / 3.0 * np.eye(3)
    place = np.linalg.solve(normal, np.einsum("nci,nc->i", lever, torque))
    return np.asarray(np.clip(place, -0.9 * PAYLOAD_REACH, 0.9 * PAYLOAD_REACH))


def payload_centre(recorded: RecordedMotion) -> Array:
    """(3,) m, the nominal payload's centre of mass; the sensor's origin when it weighs nothing."""
    mass = float(recorded.phi[0])
    return np.asarray(recorded.phi[1:4] / mass) if abs(mass) > 1e-3 else np.zeros(3)


def by_axis(tensor: Array) -> Array:
    """(N, 6, 6) response to the entries of n n^T, see `PAIRS`, from (N, 6, 3, 3): along axis i under the swing of j."""
    return np.stack([tensor[:, :, i, j] + (tensor[:, :, j, i] if i != j else 0.0) for i, j in PAIRS], axis=2)


def best_fit(columns: Array, wanted: Array) -> tuple[Array, float]:
    """Least squares by the normal equations: (k,) coefficients of (R, k) columns, and the squared residual."""
    normal, right = columns.T @ columns, columns.T @ wanted
    normal[np.diag_indices(len(normal))] += 1e-9 * np.trace(normal) / len(normal) + 1e-300
    found = np.asarray(np.linalg.solve(normal, right), dtype=np.float64)
    return found, float(wanted @ wanted - right @ found)
