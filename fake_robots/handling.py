"""What the hand of a simulated arm does to the world around it, and what the world does to its sensor."""

from collections.abc import Callable

import numpy as np
import pinocchio as pin

from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.link_frames import LinkFrames
from poise.fake_robots.world import Hand, Held, World
from poise.geometry import Pose
from poise.robot import RobotModel, SensorMotion, inertia_of, phi_of
from poise.simulation import JointMotion
from poise.types import Array

_TICK = 0.02  # s between two looks at the hand
_KEPT = 100  # ticks


class Handling:
    """The hand in the world, tick by tick.

    Args:
        world: the objects.
        model: of the arm.
        frames: of its links.
        gripper: whose fingers grasp.
        tool_frame: between the finger tips, z out of the hand, y along the closing direction.
        root: pose of the robot's root link in the world.
    """

    def __init__(
        self,
        world: World,
        model: RobotModel,
        frames: LinkFrames,
        gripper: SimulatedGripper,
        tool_frame: str,
        root: Pose,
    ) -> None:
        self.world, self._frames, self._gripper, self._tool_frame = world, frames, gripper, tool_frame
        self.root = root
        sensor, tool = (model.pinocchio.frames[model.frame_id(name)] for name in (model.sensor_frame, tool_frame))
        self._sensor_tool = pin.SE3(sensor.placement.actInv(tool.placement))
        self.reset()

    def reset(self) -> None:
        """Be as at the beginning."""
        self.world.reset()
        self._first, self._felt = 0, [Held(0.0)]
        self._tools = [Pose.identity()]

    def advance(self, until: float, motion: Callable[[Array], JointMotion]) -> None:
        """Go on up to a time, s, with the motion of the arm."""
        while (tick := self._first + len(self._felt)) * _TICK <= until:
            seconds = np.array([tick * _TICK])
            position = motion(seconds).position[0]
            poses = self._frames.poses((self._tool_frame, self._frames.base), position)
            tool, base = (self.root @ pose for pose in poses)
            opening = self._gripper.travel.opening(float(self._gripper.at(seconds)[0][0]))
            held = self.world.advance(Hand(seconds[0], tool, base, opening, self._gripper.force(seconds[0])))
            self._gripper.stop_at(held.opening if held.id else None)
            self._felt.append(held)
            self._tools.append(tool)
        if len(self._felt) > 2 * _KEPT:
            self._first += len(self._felt) - _KEPT
            del self._felt[:-_KEPT], self._tools[:-_KEPT]

    def payload(self, seconds: float) -> Array:
        """(10,) phi of what is held at a time, about the sensor's origin."""
        held = self._felt[self._row(seconds)]
        return phi_of(self._sensor_tool.act(inertia_of(held.phi_in_tool)))

    def reaction(self, seconds: float, motion: SensorMotion, gravity: Array) -> Array:
        """(N, 6) wrench in the sensor of what still holds up the held body, in the block that begins at a time."""
        row = self._row(seconds)
        held = self._felt[row]
        down = motion.gravity_in_sensor(gravity)
        force = -held.reaction * down / max(float(np.linalg.norm(gravity)), 1e-9)
        point = self._sensor_tool.act(self._tools[row].undo(held.point))
        return np.hstack([force, np.cross(point, force)])

    def _row(self, seconds: float) -> int:
        return int(np.clip(int(seconds / _TICK) - self._first, 0, len(self._felt) - 1))
