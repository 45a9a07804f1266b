"""Input checks: rates, motion, implausible joint positions, stated limits, single outliers."""

import warnings
from collections.abc import Sequence

import numpy as np

from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import runs
from poise.mismatch.effects import exceeded, within
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.nominal_model import NominalModel
from poise.mismatch.recorded import AT_REST, WRENCH_CHANNELS, RecordedMotion, moving, white_level
from poise.recording import JointStream, Stream, WrenchStream
from poise.robot import RobotModel
from poise.types import Array

_NEIGHBOURS = (-6, -5, -4, -3, -2, 2, 3, 4, 5, 6)
"""Offsets of the samples that predict the one in their middle."""
_OUTSIDE = 1.0
"""rad or m beyond its range that a joint cannot reach; ranges in descriptions are often slightly narrow."""
SHORTEST, _SLOWEST = 4.0, 15.0
"""Least duration of the wrench, s, and least rate of joint states, Hz."""
_HEAVIEST, _CARRIED = 20.0, 3.0
"""Payloads are at most so many times as heavy as the robot, and as one whose efforts say something."""
_NOISIER = 5.0
"""Ratio from which the noise that a model states is not that of the readings."""
_NO_MOTION = "nothing moves: most effects do not show at rest; record a motion of every joint"
_FROZEN, _STEPS, _MATERIAL, _FOLLOWS = 0.2, 3.0, 0.05, 0.2
"""s that a reading stays the same at least; by how many of its steps, and by what share of its range, the model changes
meanwhile in a channel; and least range of a channel, relative to that of the model, that responds at other times."""
_REPEATED = 10
"""Repetitions in a row that a single channel does not have by chance."""
_MAX_SPIKES = 0.03
"""Largest share of samples that may be spikes; more of them are not accidental."""
_FEWEST_KNOCKS, _ONE_LINE, _SEVERAL = 3, 0.9, 0.95
"""Knocks of a loose part: least number; share of their square along one direction of the six channels; and largest
share of that direction in one channel, since a knock acts on forces and torques."""


def light_robot(robot: RobotModel, phi: Array) -> list[InputFinding]:
    """A finding where the robot of the description is far too light to carry the payload (10,)."""
    own = _mass(robot)
    if not phi[0] > _CARRIED * own > 0.0:
        return []
    sentence = (
        f"The payload weighs {phi[0]:.4g} kg, and the robot {own:.3g} kg: the masses of the description are wrong. The "
        "efforts were left out."
    )
    return [InputFinding("effort_unrelated", sentence, robot.joint_names)]


def _mass(robot: RobotModel) -> float:
    """kg, of all links that move."""
    return sum(float(inertia.mass) for inertia in robot.pinocchio.inertias)


def contradicted(recorded: RecordedMotion, model: NominalModel) -> list[InputFinding]:
    """What the model states of the sensor and the readings contradict: limits, and noise that would hide effects."""
    saturation = model.effect("saturation")
    limits = saturation.values.items() if saturation is not None else ()
    wrong = [f"{name} of {value:.4g}" for name, value in limits if exceeded(recorded, name, value)]
    said = [f"Readings exceed the {what} in the model; it is not used." for what in wrong]
    found = [InputFinding("limit_exceeded", sentence) for sentence in said]
    for what, unit, noise, part in (
        ("force", "N", model.noise_force, slice(0, 3)),
        ("torque", "N m", model.noise_torque, slice(3, 6)),
    ):
        if noise is None:
            continue
        measured = float(white_level(recorded.wrench[:, part] - recorded.prediction[:, part]).max())
        if noise > _NOISIER * measured:
            sentence = (
                f"noise.{what} of the model is {noise:.3g} {unit}, that of the readings {measured:.2g} {unit}: effects "
                "below the stated noise are not found; leave it out, and it is estimated."
            )
            found.append(InputFinding("noise_stated", sentence, (), (noise, measured)))
    return found


def check_positions(robot: RobotModel, position: Array) -> None:
    """Refuse joint positions (N, J) that lie far outside their range: degrees, or another robot's description.

    Raises:
        InputError: BAD_INPUT, with the joint that is farthest out.
    """
    with np.errstate(invalid="ignore"):
        beyond = np.fmax(robot.lower - position, position - robot.upper)
    farthest = np.nan_to_num(np.where(np.isnan(beyond), -np.inf, beyond), neginf=-1.0)
    row, joint = np.unravel_index(int(np.argmax(farthest)), farthest.shape)
    if farthest[row, joint] > _OUTSIDE:
        name = robot.joint_names[joint]
        unit, other = ("m", "mm") if name in robot.prismatic else ("rad", "degrees")
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"joint {name} is at {position[row, joint]:.2f}, its range in the description is "
            f"{robot.lower[joint]:.2f} to {robot.upper[joint]:.2f} {unit}: are the positions in {other}, or is the "
            "description another robot's?",
        )


def check_payload(robot: RobotModel, phi: Array | None) -> None:
    """Refuse a payload (10,) that is far heavier than the robot.

    Raises:
        InputError: BAD_INPUT.
    """
    own = _mass(robot)
    if phi is not None and phi[0] > _HEAVIEST * own > 0.0:
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"payload.mass of the model is {phi[0]:.4g} kg, the robot of the description weighs {own:.3g} kg: give it "
            "in kg, or correct the description",
        )


def check_motion(names: Sequence[str], position: Array, recorded: RecordedMotion, name: str) -> list[InputFinding]:
    """Findings on joints that stand still.

    Args:
        names: (J) of the joints.
        position: (N, J) rad or m.
        recorded: the motion.
        name: of the recording, for the sentence.

    Raises:
        NoAnswerError: NOT_IDENTIFIABLE for joint efforts of a robot that never moves.
    """
    still = tuple(joint for joint, moves in zip(names, moving(position).tolist(), strict=True) if not moves)
    if not still:
        return []
    if len(still) < len(names) or recorded.has("base"):
        others = [joint for joint in names if joint not in still]
        sentence = (
            f"{', '.join(still)} {'stands' if len(still) == 1 else 'stand'} still, so their friction and drives do not "
            f"show; {', '.join(others) or 'the base alone'} {'moves' if len(others) < 2 else 'move'}."
        )
        return [InputFinding("joints_at_rest", sentence, still)] if recorded.has("effort") else []
    if not recorded.has("wrench"):
        raise NoAnswerError(ErrorCode.NOT_IDENTIFIABLE, f"{name}: {_NO_MOTION}")
    return [InputFinding("no_motion", f"{_NO_MOTION.capitalize()}.", still)]


def check_frame_motion(recorded: RecordedMotion) -> list[InputFinding]:
    """A finding when a sensor whose motion came from tf neither turns nor moves."""
    turned = float(np.ptp(recorded.rotation_world_sensor, axis=0).max())
    moved = float(np.ptp(recorded.position_in_world, axis=0).max())
    return [InputFinding("no_motion", f"{_NO_MOTION.capitalize()}.")] if max(turned, moved) < AT_REST else []


def check_rates(joints: JointStream, measured: Stream) -> None:
    """Refuse recordings that are too short, or too slow for accelerations.

    Raises:
        InputError: TOO_FEW_SAMPLES.
    """
    length = float(measured.stamps[-1] - measured.stamps[0]) * 1e-9
    what = "wrench lasts" if isinstance(measured, WrenchStream) else "joint states last"
    if length < SHORTEST:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"the {what} {length:.2g} s: record ten seconds or more, {SHORTEST:.0f} s at the least"
            + ("; if it was longer, its stamps are not in ns" if length < 1.0 else ""),
        )
    period = float(np.median(np.diff(joints.stamps))) * 1e-9 if len(joints) > 1 else np.inf
    if period > 1.0 / _SLOWEST:
        raise InputError(
            ErrorCode.TOO_FEW_SAMPLES,
            f"joint states come every {period:.2f} s, too slow for accelerations: record at 50 Hz or more, "
            f"{_SLOWEST:.0f} Hz at the least, or correct the unit of the stamps",
        )


def _knocks(spikes: Array) -> bool:
    """Whether spikes (K, 6) are knocks of a part in the load: one line of action and both senses.

    Transmission errors differ in their direction, or they are in one channel.
    """
    if len(spikes) < _FEWEST_KNOCKS:
        return False
    # A few large knocks must not decide for all: each spike counts by its direction.
    unit = spikes / np.linalg.norm(spikes, axis=1, keepdims=True)
    squares, lines = np.linalg.eigh(unit.T @ unit)
    along = unit @ lines[:, -1]
    return bool(
        squares[-1] > _ONE_LINE * len(spikes)
        and np.max(lines[:, -1] ** 2) < _SEVERAL
        and along.min() < 0.0 < along.max()
    )


def without_frozen(recorded: RecordedMotion) -> tuple[RecordedMotion, list[InputFinding]]:
    """The recording without spans in which the wrench repeats one reading, though the load moves, and what they are."""
    read, expected = recorded.wrench, recorded.prediction
    spans = [("The wrench", span) for span in frozen_spans(recorded.seconds, read, expected)]
    for channel, name in enumerate(WRENCH_CHANNELS):
        spans += [
            (f"{name} of the wrench", span)
            for span in stuck_spans(recorded.seconds, read[:, channel], expected[:, channel])
            if not covered(span, [known for _, known in spans])
        ]
    if not spans:
        return recorded, []
    found = [
        InputFinding(
            "wrench_frozen",
            f"{what} repeats one reading from {begin:.2f} s to {end:.2f} s, though the load moves: the sensor or its "
            "driver stopped; this span was left out.",
            (),
            (begin, end),
        )
        for what, (begin, end) in spans
    ]
    return recorded.select(~within(recorded.seconds, [span for _, span in spans])), found


def frozen_spans(seconds: Array, readings: Array, expected: Array) -> list[tuple[float, float]]:
    """Begin and end, s, of spans in which all channels repeat one reading, though the model changes.

    The reading of a coarse sensor stays the same as well, but not where the model changes by several of its steps.

    Args:
        seconds: (N,). readings, expected: (N, C) as measured, and of the model.
    """
    change = np.abs(np.diff(readings, axis=0))
    same = np.asarray((change <= 1e-12 * np.abs(readings[1:])).all(axis=1))
    steps = np.array([np.min(each[each > 0.0], initial=np.inf) for each in change.T])
    reach = np.maximum(np.ptp(expected, axis=0), 1e-9)
    found = []
    for first, last in runs(same):
        begin, end = float(seconds[first]), float(seconds[last + 1])
        if end - begin < _FROZEN:
            continue
        moved = np.ptp(expected[first : last + 2], axis=0)
        if ((moved > _STEPS * steps) & (moved / reach > _MATERIAL)).any():
            found.append((begin, end))
    return found


def covered(span: tuple[float, float], others: Sequence[tuple[float, float]]) -> bool:
    """Whether a span lies inside one of others."""
    return any(begin <= span[0] and span[1] <= end for begin, end in others)


def stuck_spans(seconds: Array, reading: Array, expected: Array) -> list[tuple[float, float]]:
    """As `frozen_spans`, of one channel (N,) that follows the model (N,) elsewhere; not at the ends of its range."""
    if np.ptp(reading) < _FOLLOWS * np.ptp(expected):
        return []
    ends = [value for value in (reading.min(), reading.max()) if value != 0.0]
    found = []
    for begin, end in frozen_spans(seconds, reading[:, None], expected[:, None]):
        first, last = np.searchsorted(seconds, (begin, end))
        # A coarse reading may be the same before and after a gap.
        if last - first >= _REPEATED and reading[first] not in ends:
            found.append((begin, end))
    return found


def without_spikes(recorded: RecordedMotion) -> tuple[RecordedMotion, list[str]]:
    """The recording without single samples far from their neighbours (transmission errors, not physics)."""
    residual = recorded.wrench - recorded.prediction
    out = np.zeros(len(recorded), dtype=bool)
    for _ in range(2):  # spikes found first must not hide their neighbours
        calm = np.where(out[:, None], np.nan, residual)
        with warnings.catch_warnings():  # NaN is right where no neighbour is valid
            warnings.simplefilter("ignore", RuntimeWarning)
            around = np.nanmedian(np.stack([np.roll(calm, shift, axis=0) for shift in _NEIGHBOURS]), axis=0)
        off = residual - around
        spread = 1.4826 * np.nanmedian(np.abs(off), axis=0)
        out = np.nan_to_num(np.abs(off / np.maximum(spread, 1e-9)).max(axis=1)) > 8.0
        out[:6] = out[-6:] = False
    beside = np.convolve(out.astype(float), np.ones(5), mode="same") > 2.5
    out &= ~beside
    if not out.any() or out.mean() > _MAX_SPIKES or _knocks(off[out] / np.maximum(spread, 1e-9)):
        return recorded, []
    return recorded.select(~out), [f"{int(out.sum())} wrench samples are single outliers and were left out"]
