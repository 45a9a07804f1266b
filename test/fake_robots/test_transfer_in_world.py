"""A planned transfer, executed by the fake arm in its world: the can stands where the planner wants it."""

import itertools
from pathlib import Path

import numpy as np
import pytest

from poise.assembly import Analysis, Cylinder, RigidObject, load_scene
from poise.fake_robots.arm import ArmOptions, Equipment, SimulatedArm, Waypoints
from poise.fake_robots.grip import Pads
from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.handling import Handling
from poise.fake_robots.link_frames import LinkFrames
from poise.fake_robots.world import QuasistaticWorld
from poise.geometry import Pose
from poise.manipulation import Arm, Gripper, Limits, Reach, plan_transfer, steps_of
from poise.placement import Options, plan_placement
from poise.recording import typestore
from poise.robot import RobotModel, find_urdf
from poise.simulation import IdealRobot, JointNoise, home, wrench_noise

SCENE = load_scene(Path(__file__).resolve().parents[2] / "docs" / "scenes" / "placement" / "cube.yaml")
CAN = RigidObject("can", Cylinder(0.03, 0.1), Pose.from_vector([-0.1, -0.42, 0.05, 0, 0, 0, 1]), mass=0.3)
BASE = Pose.from_vector([-0.5, 0, 0, 0, 0, 0, 1])


def test_a_can_stands_on_the_cube_where_it_was_planned_and_was_weighed_on_the_way():
    model, description = RobotModel.from_file("fr3"), find_urdf("fr3").read_text()
    reach = Reach(Arm.load("fr3", BASE), Analysis.of(SCENE), CAN, start=home(model), seed=1)
    found = plan_placement(reach.before, CAN, Options(candidates=1, on="objects", tests=reach.tests), 1)
    transfer = plan_transfer(reach, found.analysis, found.item, Limits(speed=0.5), 60.0, 1)
    fingers = SimulatedGripper("fingers", 2.0)
    world = QuasistaticWorld(SCENE.with_object(CAN), Pads())
    handling = Handling(world, model, LinkFrames(description, model), fingers, "tcp", BASE)
    options = ArmOptions(wrench_noise("none", rate=10.0), JointNoise(rate=10.0))
    arm = SimulatedArm(IdealRobot(model), description, None, options, Equipment(fingers, handling=handling))
    stream, now, gripper = arm.messages(), 0.0, Gripper()
    weights = {}
    for step in steps_of(transfer, 0.5):
        if step.motion is None:
            arm.grip(["fingers"], gripper.position(step.opening, step.holding))
            now += 0.8
        else:
            motion = step.motion
            given = motion.times[1:], motion.position[1:], motion.velocity[1:], motion.acceleration[1:]
            arm.command(Waypoints(model.joint_names, *given))
            now += motion.duration + 0.3  # a command begins with the next message of the joints, up to 0.1 s later
        messages = list(itertools.takewhile(lambda message, until=now: message.time < until * 1e9, stream))
        data = [message.data for message in messages if message.topic == "wrench"][-1]
        force = typestore().deserialize_cdr(data, "geometry_msgs/msg/WrenchStamped").wrench.force
        weights[step.name] = float(np.linalg.norm([force.x, force.y, force.z]))
    assert weights["lift"] == pytest.approx(0.3 * 9.80665, rel=1e-3)
    assert weights["carry"] == pytest.approx(0.3 * 9.80665, rel=1e-3)
    assert weights["retreat"] == 0.0
    assert world.remarks == ["can is released: the fingers opened"]
    placed = world.objects["can"]
    np.testing.assert_allclose(placed.pose.translation, found.item.pose.translation, atol=1.5e-3)
    assert Analysis.of(SCENE.with_object(placed)).stability().stable
