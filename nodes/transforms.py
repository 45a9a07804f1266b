"""Where frames are to each other, from tf messages: the newest transform of each frame to its parent."""

from tf2_msgs.msg import TFMessage

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose


class Frames:
    """The tree of frames that tf tells of."""

    def __init__(self) -> None:
        self._parent: dict[str, tuple[str, Pose]] = {}

    def add(self, message: TFMessage) -> None:
        """Take in transforms; one that is not finite, or whose quaternion is no rotation, is left out.

        Raises:
            InputError: NOT_FINITE, naming the last frame left out.
        """
        wrong = None
        for stamped in message.transforms:
            shift, turn = stamped.transform.translation, stamped.transform.rotation
            length = turn.x**2 + turn.y**2 + turn.z**2 + turn.w**2
            if not (abs(length - 1) < 1e-2 and abs(shift.x + shift.y + shift.z) < float("inf")):
                wrong = stamped.child_frame_id
                continue
            pose = Pose.from_vector([shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w])
            self._parent[stamped.child_frame_id] = stamped.header.frame_id, pose
        if wrong is not None:
            raise InputError(ErrorCode.NOT_FINITE, f"tf: the transform of {wrong} is not one; it was left out")

    def pose(self, frame: str, reference: str) -> Pose | None:
        """Where a frame is in another; None when tf does not connect them."""
        of_frame, of_reference = self._chain(frame), self._chain(reference)
        for ancestor, in_frame in of_reference.items():
            if ancestor in of_frame:
                there = of_frame[ancestor]
                return Pose(in_frame.rotation.T @ there.rotation, in_frame.undo(there.translation))
        return None

    def _chain(self, frame: str) -> dict[str, Pose]:
        """Where a frame is, in itself and in each of its ancestors."""
        pose = Pose.from_vector([0, 0, 0, 0, 0, 0, 1])
        chain = {frame: pose}
        while frame in self._parent:
            frame, step = self._parent[frame]
            if frame in chain:  # a circle
                break
            pose = Pose(step.rotation @ pose.rotation, step.apply(pose.translation))
            chain[frame] = pose
        return chain
