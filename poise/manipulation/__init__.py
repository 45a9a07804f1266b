"""Whether and how an arm can bring an object to its placement.

- `Arm`: a robot at its place in the scene. `Hand`: its two fingers; `Gripper`: the joint that moves them.
- `Reach`: for `looks` and `tests` of `poise.placement.Options`: clearance of the hand, one grasp for pick and place.
- `plan_transfer`: pick, carry, place as motions in time.
- `plan_pick`, `PickExecution`: pick alone, verified by what was lifted (`lifted_mass`), or put down again.
- `TransferExecution`: the execution of a transfer through a `RobotPort`, supervised within `Tolerances`.
- `plan_base_motion`, `BaseExecution`: a base that carries objects under their acceleration limits.
- `plan_look`: a sweep of a camera on the hand over a region, as a motion.
- `with_stops`: the stops of its motions, chosen ahead.
"""

from poise.manipulation.arm import Arm, standing_at
from poise.manipulation.base_execution import BaseExecution, BaseTolerances
from poise.manipulation.base_motion import BaseDrive, BaseLimits, plan_base_motion
from poise.manipulation.bodies import pose_of, se3_of
from poise.manipulation.carrying import Transfer, TransferPhase, plan_transfer
from poise.manipulation.execution import RobotPort, Tolerances, TransferExecution, TransferStep, steps_of
from poise.manipulation.gripper import Grip, Gripper
from poise.manipulation.hand import Grasp, Hand
from poise.manipulation.held import HeldReach, grasp_of_held
from poise.manipulation.lifting import LiftedMass, lifted_mass
from poise.manipulation.looking import LookPlan, plan_look
from poise.manipulation.pick_execution import ForceWatch, PickExecution
from poise.manipulation.picking import Pick, PickSteps, heavier, pick_steps, plan_pick, without_held
from poise.manipulation.reach import Ends, Reach, require_room
from poise.manipulation.stopping import with_stops
from poise.manipulation.timing import Limits

__all__ = [
    "Arm",
    "BaseDrive",
    "BaseExecution",
    "BaseLimits",
    "BaseTolerances",
    "Ends",
    "ForceWatch",
    "Grasp",
    "Grip",
    "Gripper",
    "Hand",
    "HeldReach",
    "LiftedMass",
    "Limits",
    "LookPlan",
    "Pick",
    "PickExecution",
    "PickSteps",
    "Reach",
    "RobotPort",
    "Tolerances",
    "Transfer",
    "TransferExecution",
    "TransferPhase",
    "TransferStep",
    "grasp_of_held",
    "heavier",
    "lifted_mass",
    "pick_steps",
    "plan_base_motion",
    "plan_look",
    "plan_pick",
    "plan_transfer",
    "pose_of",
    "require_room",
    "se3_of",
    "standing_at",
    "steps_of",
    "with_stops",
    "without_held",
]
