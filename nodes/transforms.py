"""From tf messages to a tree of frames."""

import math

from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode, InputError
from poise.geometry import rotation_of_quaternion
from poise.recording import stamp_of
from poise.robot import FrameTree


def add_transforms(tree: FrameTree, message: TFMessage, fixed: bool = False) -> None:
    """Add the transforms of a message; one that is not finite, or without a unit quaternion, is left out.

    Args:
        tree: takes them.
        message: from tf or tf_static.
        fixed: it comes from tf_static.

    Raises:
        InputError: NOT_FINITE, naming the last frame left out; FRAME_UNKNOWN as `FrameTree.add`.
    """
    wrong = None
    for stamped in message.transforms:
        shift, turn = stamped.transform.translation, stamped.transform.rotation
        length = math.hypot(turn.x, turn.y, turn.z, turn.w)  # squares of huge numbers would overflow
        if not (abs(length - 1) < 5e-3 and abs(shift.x + shift.y + shift.z) < float("inf")):
            wrong = stamped.child_frame_id
            continue
        rotation = rotation_of_quaternion([[turn.x, turn.y, turn.z, turn.w]])
        place = [[shift.x, shift.y, shift.z]]
        stamp = [stamp_of(stamped)]
        tree.add(stamp, stamped.header.frame_id, stamped.child_frame_id, rotation, place, fixed=fixed)
    if wrong is not None:
        raise InputError(ErrorCode.NOT_FINITE, f"tf: the transform of {wrong} is not valid; it was left out")
