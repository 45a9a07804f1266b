"""Where an arm that is planned for stands: by tf, or by the parameter `base`."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.manipulation import Arm, se3_of, standing_at
from poise.robot import FrameTree


def base_of(values: Mapping[str, Any]) -> Pose:
    """The pose in the parameter `base`.

    Raises:
        InputError: BAD_INPUT.
    """
    if len(values["base"]) != 4 or not np.isfinite(values["base"]).all():
        raise InputError(ErrorCode.BAD_INPUT, "parameter base must be four finite numbers: x y z yaw")
    return standing_at(values["base"])


def placed_arm(arm: Arm, frames: FrameTree, reference: str, base: Sequence[float]) -> tuple[Arm, list[str]]:
    """The arm where tf has the link that carries its first joint, or its root link; else at a base. What was assumed.

    Args:
        arm: the robot.
        frames: of tf.
        reference: frame of the scene.
        base: the parameter, where tf has neither link.
    """
    root = str(arm.model.frames[1].name)
    for frame, place in ((arm.foot[0], arm.standing_on), (root, lambda pose: replace(arm, base=se3_of(pose)))):
        pose = Pose.identity() if frame == reference else frames.pose(frame, reference)
        if pose is not None:
            return place(pose), []
    return replace(arm, base=se3_of(standing_at(base))), [assumed_base(arm, reference, base)]


def assumed_base(arm: Arm, reference: str, base: Sequence[float]) -> str:
    """What is assumed where tf has no link of the arm; base: the parameter."""
    root, where = arm.model.frames[1].name, ", ".join(f"{value:g}" for value in base)
    return f"{root}: tf does not connect it with {reference}; it stands at the parameter base, [{where}]"
