"""Input checks of the wrench against the load of the model: signs, axes, units, dead channels, clocks seconds off."""

from dataclasses import dataclass
from functools import cache
from itertools import product, starmap

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import nearest_rotation
from poise.mismatch.effects import limited_readings
from poise.mismatch.reading.findings import turned_base
from poise.mismatch.recorded import WRENCH_CHANNELS, RecordedMotion, linear_at, load_wrench
from poise.types import Array, Mask
from poise.weighing import (
    EXCHANGE_ERRORS,
    FORCE_UNIT_ERRORS,
    MIRROR_ERRORS,
    SIGN_ERRORS,
    TORQUE_UNIT_ERRORS,
    FixedError,
    base_axes_sentence,
    both_units,
    on_both,
)

_PARTS = (slice(0, 3), slice(3, 6))
_EXPLAINED = 0.1
"""Share of the variance of the force, or of the torque, that an error of the driver leaves at most."""
_WRONG, _MATERIAL = 0.5, 0.05
"""Shares of the variance of the channels that an error concerns, and of their force or torque, that the model leaves
at least."""
_BETTER = 0.3
"""Largest ratio of what an error leaves to what the model leaves."""
_AS_WELL, _NEGLIGIBLE = 1.3, 0.002
"""Factor, and share of the variance, within which two errors explain a wrench equally well: the commoner one counts."""
_TURNED = 0.5
"""Ratio below which a rotation explains more than an error: a turned sensor is an effect of the library."""
_WRONG_PAYLOAD, _EXACT, _FAR = 2.0, 1.05, 20.0
"""Factor by which the payload of the model may be off, beside a unit within `_FAR` and beyond: both are factors."""
_LEAST_MOUNTING = 20.0
"""degrees by which a base is turned at least; smaller tilts are an effect of the library."""
_LIMITED = 0.1
"""Share of the readings at the end of the range from which a force that does not respond is limited."""
_LONGEST_LAG, _SHORTEST_LAG, _LAG_STEP = 10.0, 0.3, 0.02
"""s: clock errors that are looked for; shorter ones are effects of the library."""
_ALIGNED, _MISALIGNED = 0.95, 5.0
"""Least correlation of wrench and model with the right clock, and by how much less the recorded clock has."""


@dataclass(frozen=True, eq=False)
class WrenchMoments:
    """(6, 6) second moments of the wrench that is read and of the model's, both without their means."""

    read: Array
    cross: Array
    expected: Array

    @staticmethod
    def of(read: Array, expected: Array) -> "WrenchMoments":
        a, b = (values - values.mean(axis=0) for values in (read, expected))
        return WrenchMoments(a.T @ a, a.T @ b, b.T @ b)

    @property
    def unexplained(self) -> Array:
        """(2,) share of the variance of force and torque that the model leaves; its payload may be off by a factor."""
        left = self.left(np.eye(6), _WRONG_PAYLOAD)
        return np.array([left[part].sum() for part in _PARTS])

    @property
    def turned(self) -> Array:
        """(6,) as `left`, of the best fixed rotation of the sensor."""
        return self.left(_best_rotation(self), _WRONG_PAYLOAD)

    @property
    def share(self) -> Array:
        """(6,) variance of each channel, relative to that of the force or of the torque."""
        own = np.diag(self.read)
        return np.concatenate([own[part] / max(own[part].sum(), 1e-12) for part in _PARTS])

    def left(self, matrix: Array, factor: float, unit: bool = False) -> Array:
        """(6,) variance of each channel that the model seen through a matrix leaves, relative to that of its part.

        The load may differ from the model's by a factor: of a unit, not by more; else, the rest is left.
        """
        own, both = np.diag(self.read), np.diag(self.cross @ matrix.T)
        seen = np.diag(matrix @ self.expected @ matrix.T)
        left = np.zeros(6)
        for part in _PARTS:
            best = both[part].sum() / max(seen[part].sum(), 1e-12)
            gain = np.clip(best, 1.0 / factor, factor)
            if unit and gain != best:
                left[part] = 1.0
                continue
            energy = own[part] - 2.0 * gain * both[part] + gain**2 * seen[part]
            left[part] = energy / max(own[part].sum(), 1e-12)
        return left


def check_wrench(recorded: RecordedMotion, name: str) -> None:
    """Refuse a wrench whose units, signs or axes violate the contract, or whose clock is seconds off.

    Raises:
        InputError: BAD_INPUT, with what to do.
    """
    stuck = np.flatnonzero(np.ptp(recorded.wrench, axis=0) == 0.0)
    if len(stuck):
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: {', '.join(WRENCH_CHANNELS[c] for c in stuck)} of the wrench is constant: "
            "is it at the end of its range, is the sensor on, and its driver running?",
        )
    moments = WrenchMoments.of(recorded.wrench, recorded.prediction)
    mounting = _mounting(recorded, moments)
    if mounting is not None:
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: {mounting}")
    error = _error(recorded, moments)
    if error is not None and not _at_its_limit(recorded, error):
        raise InputError(ErrorCode.BAD_INPUT, f"{name}: {error.sentence}{_or_else(error)}", cause=error.code.name)
    lag = _lag(recorded) if moments.unexplained.max() > _MATERIAL else 0.0
    if lag:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{name}: the wrench fits the motion if its stamps are {abs(lag):.2f} s {'late' if lag > 0 else 'early'}: "
            "the clocks of the wrench and of the joints differ; synchronise them, or correct the stamps",
            lag=lag,
        )


def _or_else(error: FixedError) -> str:
    """Another error with the same wrench, of the model or of the joints."""
    if error.code in (ErrorCode.FORCE_UNIT, ErrorCode.TORQUE_UNIT):
        return "; or the payload of the model has another unit"
    if np.array_equal(error.matrix, -np.eye(6)):
        return "; or the robot is mounted upside down"
    if error.code is ErrorCode.TORQUE_SIGN and (np.diag(error.matrix)[3:] == -1.0).all():
        return "; or payload.com of the model has the opposite sign"
    if error.code in (ErrorCode.LEFT_HANDED_AXES, ErrorCode.FORCE_SIGN, ErrorCode.TORQUE_SIGN):
        return "; or a joint counts in the opposite direction"
    return ""


def _at_its_limit(recorded: RecordedMotion, error: FixedError) -> bool:
    """Whether a force that does not respond is at the end of its range: this is an effect of the library."""
    limited = limited_readings(recorded) if error.code is ErrorCode.SENSOR_FAULT else None
    return limited is not None and bool(limited[:, _concerned(error)].mean() > _LIMITED)


def _mounting(recorded: RecordedMotion, moments: WrenchMoments) -> str | None:
    """What is said where the load hangs along another direction than downwards; None where it does not.

    Of a base that drives, the direction is fixed in its own axes or in those of its odometry. Accelerations alone
    distinguish a base that is upside down from a wrench of the opposite sign.
    """
    most = min(_EXPLAINED, _BETTER * moments.unexplained.sum(), _TURNED * float(moments.turned.sum()))
    negative = _TURNED * float(moments.left(-np.eye(6), _WRONG_PAYLOAD).sum())
    turn = recorded.rotation_world_sensor
    tried = [] if recorded.base is None else [recorded.base.rotation_world_base.swapaxes(1, 2) @ turn]
    for rotation in (*tried, turn):
        downwards, words, left = _hanging(recorded, rotation)
        if downwards > _LEAST_MOUNTING and left < min(most, negative):
            return f"the load hangs {words}"
    return None


def _hanging(recorded: RecordedMotion, rotation: Array) -> tuple[float, str, float]:
    """By how many degrees from downwards the load hangs in the axes of a rotation (N, 3, 3) to the sensor, in words
    too, and what that leaves of the wrench beside inertia; all where it would be much heavier or lighter."""
    still = np.zeros((len(recorded), 3))
    size = float(np.linalg.norm(recorded.gravity[0]))
    along = [load_wrench(recorded.phi, size * rotation[:, axis, :], still, still) for axis in range(3)]
    moved = load_wrench(
        recorded.phi, -recorded.linear_acceleration, recorded.angular_velocity, recorded.angular_acceleration
    )
    read, *columns = (each.ravel() for each in _in_sizes(recorded.wrench, *along, moved))
    matrix = np.stack(columns, axis=1)
    found = np.asarray(np.linalg.lstsq(matrix, read, rcond=None)[0])
    direction = found[:3]
    possible = 1.0 / _WRONG_PAYLOAD < float(np.linalg.norm(direction)) < _WRONG_PAYLOAD
    left = float(np.mean((read - matrix @ found) ** 2) * 6.0) if possible else np.inf
    return *turned_base(direction), left


def _error(recorded: RecordedMotion, moments: WrenchMoments) -> FixedError | None:
    """The error of the driver that explains a wrench that the model does not."""
    without = moments.left(np.eye(6), _WRONG_PAYLOAD)
    turned = moments.turned
    in_world = WrenchMoments.of(recorded.wrench, _in_world(recorded))
    tried = [(error, moments.left(error.matrix, *_factor(error))) for error in _errors()]
    in_base = [(error, in_world.left(error.matrix, _WRONG_PAYLOAD)) for error in _of_base_axes(in_world)]
    # Of a sensor that does not turn, axes of the base are those of a turned sensor.
    tried += [(error, left) for error, left in in_base if left.sum() < _TURNED * turned.sum()]
    least = np.min([without, turned, *(left for _, left in tried)], axis=0)
    shown = np.repeat([least[part].sum() <= _EXPLAINED for part in _PARTS], 3)
    share = moments.share
    found = [
        (error, float(left[shown].sum()))
        for error, left in tried
        if _explains(shown & _concerned(error), left, without, share)
        and left[shown].sum() < _BETTER * without[shown].sum()
    ]
    if not found:
        return None
    best = min(left for _, left in found)
    if turned[shown].sum() < _TURNED * best:
        return None
    return next(error for error, left in found if left <= _AS_WELL * best + _NEGLIGIBLE)


def _explains(channels: Mask, left: Array, without: Array, share: Array) -> bool:
    """Whether an error explains the channels that it concerns, and the model does not."""
    off = without[channels].sum()
    wrong = off > max(_WRONG * share[channels].sum(), _MATERIAL)
    return bool(wrong and all(left[part].sum() <= _EXPLAINED for part in _PARTS if channels[part].any()))


def _concerned(error: FixedError) -> Mask:
    """(6,) the channels that an error changes."""
    if error.code is ErrorCode.WRONG_FRAME:
        return np.ones(6, dtype=bool)
    return np.asarray((error.matrix != np.eye(6)).any(axis=1))


def _factor(error: FixedError) -> tuple[float, bool]:
    """By which the payload may be off beside an error, and whether that is a unit."""
    size = np.abs(error.matrix).max(axis=1)
    far = np.maximum(size, 1.0 / np.maximum(size, 1e-9)).max()
    unit = error.code in (ErrorCode.FORCE_UNIT, ErrorCode.TORQUE_UNIT)
    return (_EXACT if unit and far < _FAR else _WRONG_PAYLOAD), unit


@cache
def _errors() -> tuple[FixedError, ...]:
    """Every error of a driver, the commoner ones first; a live window asks again and again."""
    units = (*FORCE_UNIT_ERRORS, *TORQUE_UNIT_ERRORS)
    both = starmap(both_units, product(FORCE_UNIT_ERRORS, TORQUE_UNIT_ERRORS))
    return (*SIGN_ERRORS, *MIRROR_ERRORS, *EXCHANGE_ERRORS, *_CHANNEL_ERRORS, *units, *both)


def _with_entry(channel: int, value: float) -> Array:
    diagonal = np.ones(6)
    diagonal[channel] = value
    return np.diag(diagonal)


_CHANNEL_ERRORS = (
    *(
        FixedError(
            ErrorCode.FORCE_SIGN if channel < 3 else ErrorCode.TORQUE_SIGN,
            f"{name} alone has the opposite sign: negate it in the driver",
            _with_entry(channel, -1.0),
        )
        for channel, name in enumerate(WRENCH_CHANNELS)
    ),
    *(
        FixedError(
            ErrorCode.SENSOR_FAULT,
            f"{name} does not respond to the load: check the cable of the sensor and the order of the channels",
            _with_entry(channel, 0.0),
        )
        # The torque of a load on the axis of the sensor is zero as well.
        for channel, name in enumerate(WRENCH_CHANNELS[:3])
    ),
    FixedError(
        ErrorCode.WRONG_FRAME,
        "force and torque are exchanged: the torque comes first; publish the force first",
        np.roll(np.eye(6), 3, axis=1),
    ),
)


def _of_base_axes(in_world: WrenchMoments) -> list[FixedError]:
    """Axes of the base, which stands turned in the world by some angle, and the same with the opposite sign."""
    return [
        FixedError(ErrorCode.WRONG_FRAME, base_axes_sentence(sign), sign * _best_rotation(in_world, sign))
        for sign in (1.0, -1.0)
    ]


def _in_world(recorded: RecordedMotion) -> Array:
    """(N, 6) the model's wrench in the axes of the world."""
    turn = recorded.rotation_world_sensor
    force, torque = (np.einsum("nij,nj->ni", turn, recorded.prediction[:, part]) for part in _PARTS)
    return np.hstack([force, torque])


def _best_rotation(moments: WrenchMoments, sign: float = 1.0) -> Array:
    """(6, 6) the rotation of force and torque that explains the wrench, or its opposite, best."""
    force, torque = (moments.cross[p, p] / max(float(np.trace(moments.read[p, p])), 1e-12) for p in _PARTS)
    turn = nearest_rotation(sign * (force + torque))
    return on_both(turn, turn)


def _lag(recorded: RecordedMotion) -> float:
    """s by which the stamps of the wrench are late, where that explains it; 0 where it does not."""
    step = max(_LAG_STEP, recorded.period)
    grid = np.arange(0.0, recorded.seconds[-1] - recorded.seconds[0], step) + recorded.seconds[0]
    read, expected = (linear_at(recorded.seconds, values, grid) for values in (recorded.wrench, recorded.prediction))
    read, expected = _in_sizes(read, expected)
    most = min(int(_LONGEST_LAG / step), len(grid) // 3)
    likeness = {shift: _likeness(read, expected, shift) for shift in range(-most, most + 1)}
    best = max(likeness, key=likeness.__getitem__)
    better = 1.0 - likeness[0] > _MISALIGNED * (1.0 - likeness[best])
    return best * step if better and abs(best) * step > _SHORTEST_LAG and likeness[best] > _ALIGNED else 0.0


def _in_sizes(read: Array, *others: Array) -> list[Array]:
    """Wrenches (N, 6) without their means, in units of how much the force and the torque that are read vary."""
    sizes = np.repeat([np.sqrt(np.sum(np.var(read[:, part], axis=0))) for part in _PARTS], 3)
    return [(values - values.mean(axis=0)) / np.maximum(sizes, 1e-9) for values in (read, *others)]


def _likeness(read: Array, expected: Array, shift: int) -> float:
    """Correlation of a wrench with the model's some samples earlier."""
    late, early = max(shift, 0), max(-shift, 0)
    a, b = read[late : len(read) - early].ravel(), expected[early : len(expected) - late].ravel()
    return float(a @ b) / max(float(np.sqrt((a @ a) * (b @ b))), 1e-12)
