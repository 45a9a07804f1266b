"""The one family of errors: a numbered code, a sentence that names what, where and the fix, and data."""

import functools
from enum import IntEnum
from typing import Any


class ErrorCode(IntEnum):
    """How a request ended; the numbers of poise_msgs/ErrorCode."""

    OK = 0
    INTERNAL = 1
    CANCELLED = 2
    BUSY = 3
    DEADLINE = 4

    BAD_INPUT = 10
    FILE_UNREADABLE = 11
    FILE_CORRUPT = 12
    FILE_UNWRITABLE = 13
    TOPIC_MISSING = 14
    TYPE_MISMATCH = 15
    TIME_BACKWARDS = 16
    EMPTY = 17
    NOT_FINITE = 18
    UNSUPPORTED = 19

    ROBOT_DESCRIPTION_MISSING = 20
    ROBOT_DESCRIPTION_INVALID = 21
    JOINT_MISSING = 22
    FRAME_UNKNOWN = 23
    JOINT_LIMIT = 24
    UNREACHABLE = 25
    NOT_FOLLOWING = 26
    NOT_HELD = 27
    TOO_HEAVY = 28

    SENSOR_UNREACHABLE = 30
    SENSOR_PROTOCOL = 31
    SENSOR_SATURATED = 32
    SENSOR_STALE = 33
    SENSOR_FAULT = 34

    NOT_IDENTIFIABLE = 40
    TOO_FEW_SAMPLES = 41
    ZEROED_UNDER_LOAD = 42
    SHAPE_MISMATCH = 43
    NOT_CONSISTENT = 44

    OBJECT_UNKNOWN = 50
    OBJECT_INVALID = 51
    UNSTABLE = 52
    FLOATING = 53
    INTERPENETRATION = 54
    POINT_OFF_SURFACE = 55
    MESH_INVALID = 56
    SCAN_INCOMPLETE = 57
    IMPLAUSIBLE = 58
    CAN_ROLL = 59

    NO_PLACEMENT = 60
    SOLVER_FAILED = 61

    POOR_FIT = 70
    SENSOR_ROTATED = 71
    WRONG_FRAME = 72
    LEFT_HANDED_AXES = 73
    FORCE_SIGN = 74
    TORQUE_SIGN = 75
    FORCE_UNIT = 76
    TORQUE_UNIT = 77
    CLIPPED = 78
    COMPENSATED = 79
    PAYLOAD_CHANGED = 80
    SENSOR_DRIFT = 81
    CLOCK_LATE = 82
    FILTERED = 83
    BASE_MOVED = 84
    IN_CONTACT = 85
    GRAVITY_WRONG = 86


class PoiseError(Exception):
    """Base class of all errors that Poise raises.

    Args:
        code: what kind of failure, for machines.
        message: one sentence for people: what, where, how to fix it.
        **data: values for programs, by name.
    """

    exit_status = 1

    def __init__(self, code: ErrorCode, message: str, **data: Any) -> None:
        super().__init__(message)
        self.code = code
        self.message = message
        self.data = data

    def __reduce__(self) -> tuple[Any, ...]:
        """Arguments for copies and for other processes, with the data."""
        return functools.partial(type(self), **self.data), (self.code, self.message)


class InputError(PoiseError):
    """An input (file, message, parameter, command line) cannot be used."""

    exit_status = 2


class NoAnswerError(PoiseError):
    """The input is fine, but the question has no answer: unstable, infeasible, not identifiable."""

    exit_status = 3


class SensorError(PoiseError):
    """A device or its stream fails."""

    exit_status = 2
