"""A call of the robustness services, as robustness_server passes it to a worker: checked, in one frame, serialized."""

from dataclasses import dataclass, field
from typing import Any

from rclpy.serialization import serialize_message

from poise.errors import ErrorCode, InputError
from poise.nodes.request_checks import CallLimits, check_request
from poise.nodes.robustness_worker import MAP_TOLERANCE
from poise.nodes.transforms import pose_between, transform_objects, transform_pushes
from poise.robot import FrameTree
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import SetAssembly

_SHORT_PUSHES, SHORT_OBJECTS = 100, 50
"""Pushes, and objects that a call brings, up to which it is not heavy."""
_OLD = 1.0
"""s from which on the age of a transform is stated."""


@dataclass(frozen=True)
class Call:
    """What a worker is asked, and what the answer presupposes.

    Args:
        kind: assess, plan or set; move: objects to the poses of tf.
        request: serialized.
        frame: of the assembly.
        uses_present: it is about the assembly that is set, whose frame must still be this one.
        heavy: it may take long.
        expected: the version that it changes; 0: any.
        notes: defaults that were used, in words.
        poses: of a move, by id.
        version: that the assembly has after it, where world_model counts; 0: the next one.
    """

    kind: str
    request: bytes
    frame: str
    uses_present: bool
    heavy: bool = False
    expected: int = 0
    notes: tuple[str, ...] = ()
    poses: dict[str, list[float]] = field(default_factory=dict)
    version: int = 0


def call_of(
    kind: str, request: Any, frames: FrameTree, present_frame: str, limits: CallLimits, longest: float, now: int = 0
) -> Call:
    """Check a request and transform it.

    Args:
        kind: assess, plan or set.
        request: of that service; changed in place.
        frames: from tf.
        present_frame: of the assembly that is set.
        limits: of one call.
        longest: deadline, s, of calls without one.
        now: ns, by which old transforms are noted.

    Raises:
        InputError: as `check_request`; FRAME_UNKNOWN.
    """
    serialized = serialize_message(request)
    if len(serialized) > limits.bytes:
        what = f"a call of {len(serialized)} bytes; this server takes {limits.bytes} at most"
        raise InputError(ErrorCode.BAD_INPUT, what)
    check_request(request, limits)
    notes: list[str] = []
    transformed, sent_in = False, ""
    if kind == "set":
        frame, uses_present, transformed = _place(request, frames, present_frame, notes)
        sent_in = request.assembly.header.frame_id
        brought = [request.assembly]
    else:
        brought, uses_present = request.assembly, not request.assembly
        frame = present_frame if uses_present else brought[0].header.frame_id
    if kind == "assess":
        if request.frame_id and request.frame_id != frame:
            transform_pushes(request.pushes, pose_between(frames, request.frame_id, frame))
            transformed, sent_in = True, request.frame_id
        if not request.model:
            notes.append("model not given; the default")
        if request.map_points and not request.map_tolerance:
            notes.append(f"map_tolerance not given; {MAP_TOLERANCE:g}")
    if not request.deadline:
        notes.append(f"deadline not given; {longest:g} s")
    elif request.deadline > longest:
        notes.append(f"deadline {request.deadline:g} s; this server takes {longest:g} s at most")
    if transformed and (age := frames.age(sent_in, frame, now)) > _OLD:
        notes.append(f"the transform of {sent_in} is the newest one, {age:.1f} s old")
    heavy = _is_heavy(kind, request, sum(len(assembly.objects) for assembly in brought))
    expected = request.expected_version if kind == "set" else 0
    if transformed:
        serialized = serialize_message(request)
    return Call(kind, serialized, frame, uses_present, heavy, expected, tuple(notes))


def _is_heavy(kind: str, request: Any, objects: int) -> bool:
    if kind == "plan" or objects > SHORT_OBJECTS:
        return True
    return kind == "assess" and (request.map_points > 0 or len(request.pushes) > _SHORT_PUSHES)


def _place(
    request: SetAssembly.Request, frames: FrameTree, present_frame: str, notes: list[str]
) -> tuple[str, bool, bool]:
    """The frame of the assembly after a change; whether one must be set; whether its poses were transformed."""
    message: AssemblyMessage = request.assembly
    frame = message.header.frame_id
    if not frame and request.operation != SetAssembly.Request.REMOVE:
        notes.append(f"frame_id not given; taken as {present_frame}")
    if request.operation == SetAssembly.Request.REPLACE:
        return frame or present_frame, False, False
    if frame and frame != present_frame and request.operation == SetAssembly.Request.ADD_OR_MOVE:
        pose = pose_between(frames, frame, present_frame)
        transform_objects(message.objects, pose)
        gravity = message.gravity
        turned = pose.rotation @ [gravity.x, gravity.y, gravity.z]
        gravity.x, gravity.y, gravity.z = turned.tolist()
        return present_frame, True, True
    return present_frame, True, False
