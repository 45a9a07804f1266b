"""Where tf has an arm that is planned for."""

from collections.abc import Sequence
from dataclasses import replace

from poise.geometry import Pose
from poise.manipulation import Arm, se3_of
from poise.robot import FrameTree


def placed_arm(arm: Arm, frames: FrameTree, reference: str) -> Arm | None:
    """The arm where tf has the link that carries its first joint, or its root link; None when it has neither."""
    root = str(arm.model.frames[1].name)
    for frame, place in ((arm.foot[0], arm.standing_on), (root, lambda pose: replace(arm, base=se3_of(pose)))):
        pose = Pose.identity() if frame == reference else frames.pose(frame, reference)
        if pose is not None:
            return place(pose)
    return None


def assumed_base(arm: Arm, reference: str, base: Sequence[float]) -> str:
    """What is assumed where `placed_arm` finds nothing; base: that parameter."""
    root, where = arm.model.frames[1].name, ", ".join(f"{value:g}" for value in base)
    return f"{root}: tf does not connect it with {reference}; it stands at the parameter base, [{where}]"
