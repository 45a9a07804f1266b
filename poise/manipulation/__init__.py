"""Whether and how an arm can bring an object to its placement.

- `Arm`: a robot at its place in the scene. `Hand`: its two fingers; `Gripper`: the joint that moves them.
- `Reach`: for `looks` and `tests` of `poise.placement.Options`: clearance of the hand, one grasp for pick and place.
- `plan_transfer`: pick, carry, place as motions in time.
- `TransferExecution`: the execution of a transfer through a `RobotPort`, supervised within `Tolerances`.
- `with_stops`: the stops of its motions, chosen ahead.
"""

from poise.manipulation.arm import Arm, standing_at
from poise.manipulation.bodies import pose_of, se3_of
from poise.manipulation.carrying import Transfer, TransferPhase, plan_transfer
from poise.manipulation.execution import RobotPort, Tolerances, TransferExecution, TransferStep, steps_of
from poise.manipulation.gripper import Gripper
from poise.manipulation.hand import Grasp, Hand
from poise.manipulation.reach import Ends, Reach, require_room
from poise.manipulation.stopping import with_stops
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
    "TransferStep",
    "plan_transfer",
    "pose_of",
    "require_room",
    "se3_of",
    "standing_at",
    "steps_of",
    "with_stops",
]
