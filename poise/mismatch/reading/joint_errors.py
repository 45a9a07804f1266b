"""Errors of a driver in joint states: a second publisher, whole turns, encoders that freeze."""

from dataclasses import replace

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import runs
from poise.mismatch.reading.findings import InputFinding
from poise.mismatch.reading.sanity import SHORTEST
from poise.recording import JointStream
from poise.robot import RobotModel, blanks, lapsed, left_out, stands_alone, without_turns
from poise.types import Array, Mask

_MIXED = 0.3
"""Share of the joint states that stand alone from which two publishers cannot be distinguished."""
_LONGEST_STOP, _ELSEWHERE = 0.3, 0.05
"""s that a position stays exactly the same, and share of its range that another joint moves meanwhile."""
_STEPS, _LEAP = 0.99, 5.0
"""Share of the steps of a motion that are no leaps after a stop of the driver, and how much larger a leap is than the
largest of these."""
_WIDTHS, _ABRUPT = (1, 2, 4, 8), 2.0
"""Samples over which a change of the velocity counts, and how much larger that of a frozen encoder is than others."""


def without_driver_errors(joints: JointStream, robot: RobotModel) -> tuple[JointStream, list[str], list[InputFinding]]:
    """Joint states without those of another publisher, without whole turns, and without frozen positions.

    Args:
        joints: finite, in the order of time.
        robot: that they move.

    Raises:
        InputError: BAD_INPUT where the joint states alternate between two publishers, or a position froze too early.
    """
    columns = [joints.names.index(name) for name in robot.joint_names]
    turning = np.array([name not in robot.prismatic for name in robot.joint_names])
    joints, notes, mixed = _of_one_publisher(joints, columns, turning)
    joints, said = _turned_back(joints, robot, columns, turning)
    joints, frozen = _without_frozen(joints, columns)
    return joints, [*notes, *said], [*mixed, *frozen]


def _of_one_publisher(
    joints: JointStream, columns: list[int], turning: Mask
) -> tuple[JointStream, list[str], list[InputFinding]]:
    position = joints.position[:, columns]
    alone = blanks(position) | lapsed(position)
    if not alone.any():
        alone = stands_alone(position, turning)
    if not alone.any():
        return joints, [], []
    odd = position[alone]
    count, share = int(alone.sum()), float(alone.mean())
    if share > _MIXED and np.ptp(odd, axis=0).any():
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"{share:.0%} of the joint states jump away from the ones before and after them: two publishers write to "
            "joint_states; record one of them",
        )
    if count < 3 or np.ptp(odd, axis=0).any():
        return *left_out(joints, alone, "joint states are single outliers"), []
    # Those near the motion do not stand alone.
    other = (position == odd[0]).all(axis=1)
    sentence = (
        f"Two publishers write to joint_states: {other.sum()} of {len(joints)} messages jump to "
        f"{' '.join(f'{value:.3g}' for value in odd[0])}, and the next ones jump back. They were left out; stop the "
        "other publisher, or write nothing where a table has no sample."
    )
    return joints.select(~other), [], [InputFinding("joints_mixed", sentence, tuple(joints.names[c] for c in columns))]


def _turned_back(
    joints: JointStream, robot: RobotModel, columns: list[int], turning: Mask
) -> tuple[JointStream, list[str]]:
    """Positions without jumps of whole turns, inside the range of the description where turns lead there."""
    position = joints.position.copy()
    turned = [c for c, turns in zip(columns, turning.tolist(), strict=True) if turns]
    position[:, turned] = without_turns(joints.seconds, position[:, turned])
    changed = [(j, c) for j, c in enumerate(columns) if (position[:, c] != joints.position[:, c]).any()]
    if not changed:
        return joints, []
    for j, c in changed:  # the first reading may have been of another turn
        middle = 0.5 * (robot.lower[j] + robot.upper[j])
        if np.isfinite(middle) and (position[:, c].max() > robot.upper[j] or position[:, c].min() < robot.lower[j]):
            position[:, c] += 2.0 * np.pi * np.round((middle - np.median(position[:, c])) / (2.0 * np.pi))
    names = ", ".join(robot.joint_names[j] for j, _ in changed)
    return replace(joints, position=position), [f"the positions of {names} were read without jumps of whole turns"]


def _without_frozen(joints: JointStream, columns: list[int]) -> tuple[JointStream, list[InputFinding]]:
    seconds, frozen, found = joints.seconds, np.zeros(len(joints), dtype=bool), []
    reach = np.maximum(np.ptp(joints.position, axis=0), 1e-9)
    for c in columns:
        values = joints.position[:, c]
        for first, last in _stops(seconds, values):
            others = [other for other in columns if other != c]
            moved = np.ptp(joints.position[first : last + 1, others], axis=0) / reach[others]
            if not (moved > _ELSEWHERE).any() and not _leaps(values, last):
                continue
            frozen[first + 1 : last + 1] = True
            begin, end = float(seconds[first]), float(seconds[last])
            sentence = (
                f"{joints.names[c]} stays at exactly {values[first]:.4g} from {begin:.2f} s to {end:.2f} s, after a "
                "stop that is too abrupt for a joint: its encoder or driver stopped; this span was left out."
            )
            found.append(InputFinding("encoder_frozen", sentence, (joints.names[c],), (begin, end)))
    if found and float(np.ptp(seconds[~frozen])) < SHORTEST:
        raise InputError(ErrorCode.BAD_INPUT, f"{found[0].sentence[:-1]}, and too little remains")
    return (joints.select(~frozen) if found else joints), found


def _leaps(values: Array, last: int) -> bool:
    """Whether a position (N,) goes on from a sample with a step that no motion of this joint makes: it moved unseen."""
    steps = np.abs(np.diff(values))
    usual = float(np.quantile(steps[steps > 0.0], _STEPS)) if steps.any() else 0.0
    return last + 1 < len(values) and abs(float(values[last + 1] - values[last])) > _LEAP * usual


def _stops(seconds: Array, values: Array) -> list[tuple[int, int]]:
    """First and last sample of spans in which a position (N,) is exactly the same after an abrupt stop.

    It moved farther just before than any other change of the velocity in this joint explains.
    """
    spans = [(first, last + 1) for first, last in runs(np.diff(values) == 0.0)]
    spans = [(first, last) for first, last in spans if seconds[last] - seconds[first] > _LONGEST_STOP]
    abrupt = set()
    for width in _WIDTHS if spans else ():
        bend = np.abs(values[2 * width :] - 2.0 * values[width:-width] + values[: -2 * width])
        elsewhere = np.ones(len(bend), dtype=bool)
        # Where a position goes on after it was frozen, it jumps.
        for end in np.ravel(spans):
            elsewhere[max(end - 2 * width, 0) : end + 1] = False
        most = float(bend[elsewhere].max(initial=0.0))
        inner = [span for span in spans if 0 < span[0] - width < len(bend)]
        abrupt |= {(first, last) for first, last in inner if bend[first - width] > _ABRUPT * most > 0.0}
    return sorted(abrupt)
