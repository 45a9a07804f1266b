"""Whether and how an arm puts an object where it stays.

- `Arm`: a robot at its place in the scene. `Hand`: its two fingers; `Gripper`: the joint that moves them.
- `Reach`: for `looks` and `tests` of `poise.placement.Options`: room for the hand, a grasp that serves at both ends.
- `plan_transfer`: pick, carry, place as motions in time.
- `TransferExecution`: such a transfer carried out through a `RobotPort`, supervised within `Tolerances`.
"""

from poise.manipulation.arm import Arm, standing_at
from poise.manipulation.bodies import pose_of
from poise.manipulation.carrying import Transfer, TransferPhase, plan_transfer
from poise.manipulation.execution import RobotPort, Tolerances, TransferExecution, steps_of
from poise.manipulation.gripper import Gripper
from poise.manipulation.hand import Grasp, Hand
from poise.manipulation.reach import Ends, Reach, require_room
from poise.manipulation.timing import Limits

__all__ = [
    "Arm",
    "Ends",
    "Grasp",
    "Gripper",
    "Hand",
    "Limits",
    "Reach",
    "RobotPort",
    "Tolerances",
    "Transfer",
    "TransferExecution",
    "TransferPhase",
    "plan_transfer",
    "pose_of",
    "require_room",
    "standing_at",
    "steps_of",
]
