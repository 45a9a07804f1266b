"""A can on a cube on a floor: a small assembly to draw."""

from poise.assembly import Box, Cylinder, RigidObject
from poise.geometry import Pose

UPRIGHT = (0, 0, 0, 1)
FLOOR = RigidObject("floor", Box((4, 4, 0.1)), Pose.from_vector([0, 0, -0.05, *UPRIGHT]), fixed=True)
CUBE = RigidObject("cube", Box((1, 1, 1)), Pose.from_vector([0, 0, 0.5, *UPRIGHT]), mass=1.0)
CAN = RigidObject("can", Cylinder(0.2, 0.5), Pose.from_vector([0.1, 0, 1.25, *UPRIGHT]), mass=0.5)
