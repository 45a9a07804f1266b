"""A holonomic base: it follows velocities within its accelerations, and stops when it hears none."""

from xml.etree import ElementTree

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.robot import parse_urdf
from poise.types import Array

BASE_JOINTS = ("base_x", "base_y", "base_yaw")
"""Joints of a mobile base in a robot description."""
_STEP = 0.002  # s
_KEPT = 4000  # steps that can still be asked for


class Drive:
    """Where a base is that follows commands of velocity in its own axes.

    Args:
        acceleration: m/s2, and rad/s2, of a change of velocity.
        timeout: s without a command after which it stops.
    """

    def __init__(self, acceleration: tuple[float, float] = (1.0, 2.0), timeout: float = 0.5) -> None:
        self._acceleration = np.array(acceleration)
        self._timeout = timeout
        self.reset()

    def reset(self) -> None:
        """Be at rest at the origin."""
        self._command = (-np.inf, np.zeros(3))  # s, and forward, left, turning; one assignment
        self._own = np.zeros(3)  # velocity in its own axes
        self._first = 0
        self._states = [np.zeros((3, 3))]  # x y yaw, and their first and second derivatives, at each step

    def command(self, velocity: Array, seconds: float) -> None:
        """Drive (3,) forward, left m/s, and turn rad/s, from a time, s.

        Raises:
            InputError: NOT_FINITE.
        """
        if not np.isfinite(velocity).all():
            raise InputError(ErrorCode.NOT_FINITE, "cmd_vel: a velocity is not finite; the base keeps its command")
        self._command = (seconds, np.asarray(velocity, dtype=np.float64))

    def advance(self, seconds: float) -> None:
        """Simulate up to a time, s."""
        while (self._first + len(self._states) - 1) * _STEP < seconds:
            self._step((self._first + len(self._states) - 1) * _STEP)
        if len(self._states) > 2 * _KEPT:
            self._first += len(self._states) - _KEPT
            del self._states[:-_KEPT]

    def _step(self, now: float) -> None:
        since, wanted = self._command
        target = wanted if now - since <= self._timeout else np.zeros(3)
        change = target - self._own
        for part, most in ((slice(0, 2), self._acceleration[0]), (slice(2, 3), self._acceleration[1])):
            length = float(np.linalg.norm(change[part]))
            change[part] *= min(1.0, most * _STEP / length) if length > 0 else 0.0
        self._own = self._own + change
        last = self._states[-1]
        yaw = last[0, 2] + (last[1, 2] + self._own[2]) / 2 * _STEP
        cosine, sine = np.cos(yaw), np.sin(yaw)
        forward, left, turning = self._own
        velocity = np.array([cosine * forward - sine * left, sine * forward + cosine * left, turning])
        last[2] = (velocity - last[1]) / _STEP  # which is held over the step
        self._states.append(np.stack([last[0] + (last[1] + velocity) / 2 * _STEP, velocity, np.zeros(3)]))

    def at(self, seconds: Array) -> tuple[Array, Array, Array]:
        """(N, 3) x, y, yaw in the frame where it began, and their derivatives, at times up to the last `advance`."""
        step = np.clip(np.floor(seconds / _STEP).astype(int), self._first, self._first + len(self._states) - 1)
        position, velocity, acceleration = np.moveaxis(np.array([self._states[i - self._first] for i in step]), 1, 0)
        rest = (np.maximum(seconds, 0.0) - step * _STEP)[:, None]
        position = position + velocity * rest + acceleration * rest**2 / 2
        return position, velocity + acceleration * rest, acceleration


def mounted_on_base(description: str, height: float) -> str:
    """A robot description with its root link on a base that drives.

    Args:
        description: a URDF without a mobile base.
        height: m of the root link over the floor.

    Raises:
        InputError: ROBOT_DESCRIPTION_INVALID as `parse_urdf`; BAD_INPUT when it has a link or joint of the base.
    """
    tree = parse_urdf(description)
    names = {"odom", "base_x_link", "base_y_link", "base_footprint", "base_column", *BASE_JOINTS}
    robot = ElementTree.fromstring(description.strip())
    if taken := sorted(names & {element.get("name", "") for element in robot}):
        raise InputError(ErrorCode.BAD_INPUT, f"parameter base: the robot has {', '.join(taken)} already")
    body = f"""<robot>
  <link name="odom"/><link name="base_x_link"/><link name="base_y_link"/>
  <link name="base_footprint">
    <inertial><origin xyz="0 0 {height / 2}"/><mass value="150"/>
      <inertia ixx="10" ixy="0" ixz="0" iyy="15" iyz="0" izz="20"/></inertial>
    <visual><origin xyz="0 0 {height / 2}"/><geometry><box size="0.9 0.7 {height}"/></geometry></visual>
  </link>
  <joint name="base_x" type="prismatic"><parent link="odom"/><child link="base_x_link"/><axis xyz="1 0 0"/>
    <limit lower="-50" upper="50" velocity="1.5" effort="2000"/></joint>
  <joint name="base_y" type="prismatic"><parent link="base_x_link"/><child link="base_y_link"/><axis xyz="0 1 0"/>
    <limit lower="-50" upper="50" velocity="1.5" effort="2000"/></joint>
  <joint name="base_yaw" type="continuous"><parent link="base_y_link"/><child link="base_footprint"/>
    <axis xyz="0 0 1"/><limit velocity="2" effort="1000"/></joint>
  <joint name="base_column" type="fixed"><parent link="base_footprint"/><child link="{tree.root}"/>
    <origin xyz="0 0 {height}"/></joint>
</robot>"""
    for element in reversed(list(ElementTree.fromstring(body))):
        robot.insert(0, element)
    return ElementTree.tostring(robot, encoding="unicode")
