"""What set_assembly does with an assembly: shared by the nodes that serve it, robustness_server and world_model."""

from collections.abc import Sequence
from pathlib import Path

import numpy as np

from poise.assembly import Analysis, Assembly
from poise.assembly.statics import Deadline, Stability
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.nodes.assembly_message import NOT_GIVEN, assembly_of, notes_of, objects_of, pairs_of
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import SetAssembly


def changed(before: Assembly | None, request: SetAssembly.Request, folders: Sequence[Path]) -> Assembly:
    """The assembly that a request asks for, with poses as they were seen.

    Args:
        before: the assembly that is set; None: none.
        request: checked, in the frame of the assembly.
        folders: in which meshes may lie.

    Raises:
        InputError: EMPTY when there is nothing to change; as `assembly_of`.
    """
    message = request.assembly
    if request.operation == SetAssembly.Request.REPLACE:
        return assembly_of(message, folders)
    if before is None:
        raise InputError(ErrorCode.EMPTY, "no assembly has been set; call set_assembly, or send one along")
    if request.operation == SetAssembly.Request.ADD_OR_MOVE:
        _require_setting(message, before)
        return before.with_object(*objects_of(message, folders), pairs=pairs_of(message))
    after = before
    for item in message.objects:
        after = after.without(item.id)
    return after


def stability_of(analysis: Analysis, response: SetAssembly.Response, deadline: Deadline) -> Stability:
    """Whether an assembly stands, also written into a response."""
    found = analysis.stability(deadline)
    response.stable, response.margin, response.falling = found.stable, found.margin, list(found.falling)
    response.assumptions = notes_of(analysis, deadline)
    return found


def late(what: str) -> NoAnswerError:
    """DEADLINE: what was not done by then."""
    return NoAnswerError(ErrorCode.DEADLINE, f"the deadline passed: {what}")


def not_checked() -> NoAnswerError:
    """DEADLINE of a change that is not made."""
    return late("whether the new assembly stands was not checked in time, and the assembly is as it was")


def changed_meanwhile(expected: int, version: int) -> InputError:
    """The refusal of a change to a version that is no longer the present one."""
    return InputError(
        ErrorCode.BAD_INPUT,
        f"a change of version {expected}: the assembly is version {version} by now, and was not changed; read it from "
        "the topic assembly, and send the change again",
    )


def _require_setting(message: AssemblyMessage, assembly: Assembly) -> None:
    """A change of objects gives no other gravity and friction than the assembly has, if it gives them at all."""
    gravity = np.array([message.gravity.x, message.gravity.y, message.gravity.z])
    if gravity.any() and not np.allclose(gravity, assembly.gravity, atol=1e-6):
        what = f"gravity {gravity} for {assembly.gravity}"
    elif message.friction not in (NOT_GIVEN, assembly.friction):
        what = f"friction {message.friction:g} for {assembly.friction}"
    elif message.friction_std not in (0.0, assembly.friction_deviation):
        what = f"friction_std {message.friction_std:g} for {assembly.friction_deviation:g}"
    elif message.rolling not in (NOT_GIVEN, assembly.rolling):
        what = f"rolling {message.rolling:g} for {assembly.rolling:g}"
    else:
        return
    raise InputError(ErrorCode.BAD_INPUT, f"ADD_OR_MOVE with {what}: leave it out, or use REPLACE")
