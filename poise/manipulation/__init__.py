"""Whether and how an arm puts an object where it stays.

- `Arm`: a robot at its place in the scene. `Hand`: its two fingers.
- `Reach`: for `looks` and `tests` of `poise.placement.Options`: room for the hand, a grasp that serves at both ends.
- `plan_transfer`: pick, carry, place as motions in time.
"""

from poise.manipulation.arm import Arm
from poise.manipulation.carrying import Phase, Transfer, plan_transfer
from poise.manipulation.hand import Grasp, Hand
from poise.manipulation.reach import Ends, Reach
from poise.manipulation.timing import Limits

__all__ = ["Arm", "Ends", "Grasp", "Hand", "Limits", "Phase", "Reach", "Transfer", "plan_transfer"]
