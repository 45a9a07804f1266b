"""The quasi-static world: what the hand lifts, what falls where, and what the sensor feels of it."""

import itertools

import numpy as np
import pytest

from poise.assembly import Assembly, Box, Cylinder, RigidObject
from poise.fake_robots.arm import ArmOptions, Equipment, SimulatedArm, Waypoints
from poise.fake_robots.camera import Mounted, RenderedCamera
from poise.fake_robots.drive import Drive, mounted_on_base
from poise.fake_robots.grip import Pads, squeeze
from poise.fake_robots.gripper import SimulatedGripper
from poise.fake_robots.handling import Handling
from poise.fake_robots.link_frames import LinkFrames
from poise.fake_robots.mujoco_world import MujocoWorld
from poise.fake_robots.settling import come_to_rest
from poise.fake_robots.world import Hand, QuasistaticWorld
from poise.geometry import Pose
from poise.recording import typestore
from poise.robot import RobotModel, find_urdf
from poise.scanning import Camera
from poise.simulation import IdealRobot, JointNoise, home, wrench_noise

G = 9.80665
DOWN = (1.0, 0.0, 0.0, 0.0)
CLEAN = ArmOptions(wrench_noise("none", rate=100.0), JointNoise(rate=100.0))


def at(x, y, z, quaternion=(0, 0, 0, 1)):
    return Pose.from_vector([x, y, z, *quaternion])


def body(name, shape, pose, mass=0.5, **fields):
    return RigidObject(name, shape, pose, mass=mass, **fields)


TABLE = RigidObject("table", Box((1.0, 1.0, 0.1)), at(0, 0, -0.05), fixed=True)
CAN = body("can", Cylinder(0.03, 0.1), at(0.3, 0, 0.05))


class Hands:
    """A hand that points down, moved tick by tick."""

    def __init__(self, *objects, riding=(), friction=0.5, engine=QuasistaticWorld):
        self.world = engine(Assembly((TABLE, *objects)), Pads(friction=friction), riding)
        self.time, self.opening, self.force, self.base = 0.0, 0.085, 0.0, Pose.identity()
        self.place, self.felt = np.array([0.3, 0.0, 0.05]), None

    def tick(self):
        self.time += 0.02
        tool = at(*self.place, DOWN)
        self.felt = self.world.advance(Hand(self.time, tool, self.base, self.opening, self.force))
        if self.felt.id:
            self.opening = max(self.opening, self.felt.opening)

    def close(self, force=100.0, to=0.01):
        self.force = force
        for opening in np.linspace(self.opening, to, 30):
            self.opening = max(opening, self.felt.opening if self.felt and self.felt.id else 0.0)
            self.tick()
        return self

    def go(self, *place, steps=40):
        for share in np.linspace(0, 1, steps):
            before = self.place
            self.place = before + share * (np.array(place) - before)
            self.tick()
        return self

    def let_go(self):
        self.opening, self.force = 0.085, 0.0
        self.tick()
        return self

    def pose(self, name):
        return self.world.objects[name].pose


def test_a_body_is_lifted_carried_and_put_down():
    hand = Hands(CAN).close()
    assert hand.felt.id == "can"
    assert hand.felt.opening == pytest.approx(0.06, abs=1e-4)
    assert hand.felt.reaction == pytest.approx(0.5 * G)  # the table still bears it
    hand.go(0.3, 0.0, 0.25)
    assert hand.felt.reaction == 0.0
    assert hand.felt.phi_in_tool[0] == pytest.approx(0.5)
    np.testing.assert_allclose(hand.pose("can").translation, [0.3, 0.0, 0.25], atol=1e-9)
    hand.go(0.1, 0.2, 0.05 - 0.0005)
    assert hand.felt.reaction == pytest.approx(2e4 * 0.0005, rel=0.05)  # pressed onto the table
    hand.let_go()
    assert hand.felt.id == ""
    np.testing.assert_allclose(hand.pose("can").translation, [0.1, 0.2, 0.05], atol=1e-4)


def test_an_open_hand_and_a_hand_beside_the_body_lift_nothing():
    open_hand = Hands(CAN).close(to=0.07).go(0.3, 0, 0.3)
    beside = Hands(CAN)
    beside.place = np.array([0.3, 0.0, 0.2])
    beside.close()
    for hand in (open_hand, beside):
        assert hand.felt.id == ""
        np.testing.assert_array_equal(hand.pose("can").vector, CAN.pose.vector)


def test_the_finger_that_touches_first_moves_the_body_to_the_middle():
    moved = Hands(CAN)
    moved.place = np.array([0.3, 0.008, 0.05])
    moved.close()
    assert moved.felt.id == "can"
    np.testing.assert_allclose(moved.pose("can").translation, [0.3, 0.008, 0.05], atol=1e-9)
    outside = Hands(CAN)
    outside.place = np.array([0.3, 0.02, 0.05])
    assert outside.close().felt.id == ""


def test_a_body_too_wide_stops_nothing_and_one_with_slanting_sides_slips_out():
    wide = Hands(body("block", Box((0.1, 0.1, 0.1)), at(0.3, 0, 0.05))).close()
    assert wide.felt.id == ""
    wedge = body(
        "wedge", Box((0.05, 0.05, 0.05)), at(0.3, 0, 0.05 * 2**-0.5, (np.sin(np.pi / 8), 0, 0, np.cos(np.pi / 8)))
    )
    slips = Hands(wedge, friction=0.3)
    slips.place = np.array([0.3, 0.0, 0.045])
    slips.close()
    assert slips.felt.id == ""
    assert any("slips out" in remark for remark in slips.world.remarks)


def test_too_heavy_a_body_falls_and_a_long_one_turns_between_the_pads():
    heavy = Hands(body("can", CAN.shape, CAN.pose, mass=15.0)).close().go(0.3, 0, 0.2)
    assert heavy.felt.id == ""
    assert any("too heavy" in remark for remark in heavy.world.remarks)
    np.testing.assert_allclose(heavy.pose("can").translation[2], 0.05, atol=2e-3)
    rod = body("rod", Box((0.4, 0.03, 0.03)), at(0.44, 0, 0.015), mass=2.0)
    turns = Hands(rod)
    turns.place = np.array([0.3, 0.0, 0.015])
    turns.close().go(0.3, 0.0, 0.4, steps=80)
    assert turns.felt.id == "rod"
    assert turns.world.objects["rod"].com_in_world[2] < 0.4 - 0.1  # it hangs


def test_what_stands_on_a_body_rides_on_it_and_what_leans_on_it_falls():
    lid = body("lid", Box((0.08, 0.04, 0.02)), at(0.3, 0, 0.11), mass=0.1)
    hand = Hands(CAN, lid).close().go(0.3, 0, 0.25)
    assert hand.felt.phi_in_tool[0] == pytest.approx(0.6)
    np.testing.assert_allclose(hand.pose("lid").translation, [0.3, 0, 0.31], atol=1e-4)
    plank = body("plank", Box((0.02, 0.2, 0.01)), at(0.3, 0.1, 0.105), mass=0.1)
    post = body("post", Box((0.02, 0.02, 0.1)), at(0.3, 0.19, 0.05), mass=0.1)
    hand = Hands(CAN, plank, post).close().go(0.3, 0, 0.25)
    assert hand.pose("plank").translation[2] < 0.11  # it is not taken along with its far end on the post


def test_bodies_fall_to_where_they_are_supported():
    tall = Box((0.06, 0.04, 0.2))
    upright = come_to_rest(body("a", tall, at(0, 0, 0.3)), [TABLE])
    np.testing.assert_allclose(upright.pose.vector, [0, 0, 0.1, 0, 0, 0, 1], atol=1e-4)
    tipped = come_to_rest(body("a", tall, at(0, 0, 0.3, (0.35, 0, 0, 0.94))), [TABLE])
    np.testing.assert_allclose(tipped.vertices[:, 2].max(), 0.04, atol=1e-3)
    assert come_to_rest(body("a", tall, at(0.52, 0, 0.3)), [TABLE]) is None  # beside the table's edge
    overhanging = come_to_rest(
        body("a", Box((0.2, 0.05, 0.04)), at(0.04, 0, 0.2)), [TABLE, body("b", Box((0.1,) * 3), at(0, 0, 0.05))]
    )
    assert overhanging.pose.translation[2] == pytest.approx(0.12, abs=1e-4)


def test_what_stands_on_the_tray_rides_with_the_base():
    tray = RigidObject("tray", Box((0.3, 0.3, 0.02)), at(-0.3, 0, 0.2), fixed=True)
    cup = body("cup", Cylinder(0.03, 0.1), at(-0.3, 0, 0.26))
    hand = Hands(CAN, tray, cup, riding=("tray",))
    for share in np.linspace(0, 1, 200):
        yaw = np.pi / 2 * share**2 * (3 - 2 * share)
        hand.base = at(2 * yaw / np.pi, 0.5 * yaw, 0, (0, 0, np.sin(yaw / 2), np.cos(yaw / 2)))
        hand.tick()
    np.testing.assert_allclose(hand.pose("cup").translation, hand.base.apply(np.array([-0.3, 0, 0.26])), atol=1e-9)
    np.testing.assert_array_equal(hand.pose("can").vector, CAN.pose.vector)


def drive(hand, share):
    """The base accelerates for 0.2 s at a share of friction times gravity, and keeps its speed."""
    x, most = 0.0, 0.5 * G * share * 0.2
    for speed in [*np.linspace(0, most, 11), *[most] * 20]:
        x += speed * 0.02
        hand.base = at(x, 0, 0)
        hand.tick()


@pytest.mark.parametrize(("share", "moved"), [(0.9, False), (1.3, True)])
def test_a_base_dislodges_what_it_accelerates_beyond_friction_alone(share, moved):
    """A flat brick slides at friction times gravity, and no earlier."""
    tray = RigidObject("tray", Box((1.0, 0.4, 0.02)), at(0, 0, 0.2), fixed=True)
    brick = body("brick", Box((0.1, 0.1, 0.02)), at(0, 0, 0.22))
    hand = Hands(tray, brick, riding=("tray",))
    drive(hand, share)
    off = abs(hand.pose("brick").translation[0] - hand.base.translation[0])
    assert off > 0.005 if moved else off < 1e-9
    assert bool(hand.world.remarks) == moved
    assert hand.pose("brick").translation[2] == pytest.approx(0.22, abs=1e-4)


def test_mujoco_lifts_carries_and_puts_down_too():
    pytest.importorskip("mujoco")
    hand = Hands(CAN, engine=MujocoWorld).close()
    assert hand.felt.id == "can"
    assert hand.felt.opening == pytest.approx(0.06, abs=1e-3)
    hand.go(0.3, 0.0, 0.25)
    assert (hand.felt.id, hand.felt.reaction) == ("can", 0.0)
    assert hand.felt.phi_in_tool[0] == pytest.approx(0.5)
    hand.go(0.1, 0.2, 0.051).let_go().go(0.1, 0.2, 0.15)
    assert hand.felt.id == ""
    np.testing.assert_allclose(hand.pose("can").translation, [0.1, 0.2, 0.05], atol=2e-3)
    slippery = Hands(body("can", CAN.shape, CAN.pose, mass=15.0), engine=MujocoWorld).close().go(0.3, 0, 0.25)
    assert slippery.pose("can").translation[2] < 0.1


@pytest.mark.parametrize(("share", "moved"), [(0.9, False), (1.3, True)])
def test_mujoco_agrees_when_a_base_dislodges_a_brick(share, moved):
    pytest.importorskip("mujoco")
    tray = RigidObject("tray", Box((1.0, 0.4, 0.02)), at(0, 0, 0.2), fixed=True)
    brick = body("brick", Box((0.1, 0.1, 0.02)), at(0, 0, 0.22))
    hand = Hands(tray, brick, riding=("tray",), engine=MujocoWorld)
    drive(hand, share)
    off = abs(hand.pose("brick").translation[0] - hand.pose("tray").translation[0])
    assert off > 0.01 if moved else off < 1e-3


def test_a_squeeze_is_as_wide_as_the_body_between_the_pads():
    cone = np.array([[[0, -0.02, -0.01], [0.005, 0.02, -0.03], [0, 0.02, -0.01]], [[1, 0, 0], [1, 1, 0], [1, 0, 1]]])
    found = squeeze(cone, Pads())
    assert (found.low, found.high) == pytest.approx((-0.02, 0.02))
    assert squeeze(cone + np.array([0, 0, 0.1]), Pads()) is None


def read(messages, topic, kind):
    return [typestore().deserialize_cdr(m.data, kind) for m in messages if m.topic == topic]


def robot(camera=False):
    """An FR3 at home whose finger tips are around a block on a table, and where the block is."""
    model, description = RobotModel.from_file("fr3"), find_urdf("fr3").read_text()
    frames = LinkFrames(description, model)
    tool = frames.poses(("tcp",), home(model))[0]
    block = body("block", Box((0.04, 0.04, 0.04)), tool)
    table = RigidObject(
        "table", Box((0.4, 0.4, 0.04)), at(*tool.translation[:2], block.vertices[:, 2].min() - 0.02), fixed=True
    )
    gripper = SimulatedGripper("fingers", 2.0)
    handling = Handling(
        QuasistaticWorld(Assembly((table, block)), Pads()), model, frames, gripper, "tcp", Pose.identity()
    )
    mounted = Mounted(
        "ft_sensor", "optical", at(0.075, 0, -0.0175, (0, 0, 0.5**0.5, 0.5**0.5)), Camera(80, 60, 77, 77, 40, 30), 4.0
    )
    images = RenderedCamera(mounted, 0) if camera else None
    gear = Equipment(
        gripper, handling=handling, camera=images, tf_rate=20.0, fixed_frames=(("world", "base", Pose.identity()),)
    )
    return SimulatedArm(IdealRobot(model), description, None, CLEAN, gear), tool


def test_the_wrench_of_an_arm_is_that_of_what_it_holds():
    arm, _ = robot()
    stream = arm.messages()

    def force(until):
        messages = list(itertools.takewhile(lambda message: message.time < until * 1e9, stream))
        said = read(messages, "wrench", "geometry_msgs/msg/WrenchStamped")[-1].wrench.force
        states = read(messages, "joint_states", "sensor_msgs/msg/JointState")[-1]
        return float(np.linalg.norm([said.x, said.y, said.z])), dict(zip(states.name, states.position, strict=True))

    assert force(0.2)[0] == 0.0
    arm.grip(["fingers"], 0.8)
    weight, states = force(1.0)
    assert weight == pytest.approx(0.0, abs=1e-6)  # the table bears it
    assert states["fingers"] == pytest.approx(0.8 * (1 - 0.04 / 0.085), abs=1e-6)  # the block stops the fingers
    q = home(arm.model)
    arm.command(Waypoints(["fr3_joint4"], np.array([1.0]), np.array([[q[3] + 0.15]])))
    assert force(2.5)[0] == pytest.approx(0.5 * G, rel=1e-6)
    arm.grip(["fingers"], 0.0)
    assert force(3.2)[0] == 0.0


def test_the_camera_sees_the_block_and_tf_says_where_the_links_are():
    arm, tool = robot(camera=True)
    messages = list(itertools.takewhile(lambda message: message.time < 0.7e9, arm.messages()))
    depth = read(messages, "camera/aligned_depth_to_color/image_raw", "sensor_msgs/msg/Image")
    info = read(messages, "camera/aligned_depth_to_color/camera_info", "sensor_msgs/msg/CameraInfo")
    assert len(depth) == len(info) == 2  # at 0 and 0.25 s, each 0.2 s later
    assert [each.header.stamp.nanosec for each in depth] == [0, 250_000_000]
    known = depth[0].data.view(np.uint16)
    assert (known > 0).mean() > 0.1
    static = read(messages, "tf_static", "tf2_msgs/msg/TFMessage")[0].transforms
    assert {"world", "ft_sensor"} <= {each.header.frame_id for each in static}
    (moving, *_) = read(messages, "tf", "tf2_msgs/msg/TFMessage")
    chain = Pose.identity()
    links = {each.child_frame_id: each for each in (*static, *moving.transforms)}
    link = "tcp"
    while link in links:
        t, r = links[link].transform.translation, links[link].transform.rotation
        chain = at(t.x, t.y, t.z, (r.x, r.y, r.z, r.w)) @ chain
        link = links[link].header.frame_id
    np.testing.assert_allclose(chain.vector, tool.vector, atol=1e-9)
    truth = read(messages, "world_truth", "tf2_msgs/msg/TFMessage")[0].transforms
    assert {each.child_frame_id for each in truth} == {"table", "block"}


def test_a_base_follows_cmd_vel_within_its_acceleration_and_stops_without_it():
    drive = Drive((0.5, 1.0), timeout=0.5)
    drive.command(np.array([0.4, 0.0, 0.0]), 0.0)
    drive.advance(4.0)
    seconds = np.arange(0.0, 3.0, 0.001)
    position, velocity, acceleration = drive.at(seconds)
    assert np.linalg.norm(acceleration, axis=1).max() <= 0.5 * (1 + 1e-9)
    np.testing.assert_allclose(np.gradient(position[:, 0], seconds), velocity[:, 0], atol=2e-3)
    assert velocity[:, 0].max() == pytest.approx(0.25, abs=0.01)  # 0.5 s at 0.5 m/s2
    np.testing.assert_allclose(velocity[-1], 0.0, atol=1e-12)
    with pytest.raises(Exception, match="finite"):
        drive.command(np.array([np.nan, 0, 0]), 0.0)


def test_any_arm_can_be_mounted_on_a_base_whose_motion_the_wrench_contains():
    description = mounted_on_base(find_urdf("fr3").read_text(), 0.4)
    model = RobotModel.from_urdf(description)
    assert model.base_joints == 3
    payload = np.array([1.0, 0, 0, 0, 0.01, 0, 0, 0.01, 0, 0.01])
    arm = SimulatedArm(IdealRobot(model, payload), description, None, CLEAN, Equipment(drive=Drive((2.0, 2.0))))
    arm.drive(np.array([0.5, 0.0, 0.0]))
    messages = list(itertools.takewhile(lambda message: message.time < 0.4e9, arm.messages()))
    assert {message.topic for message in messages} >= {"odom", "wrench"}
    odometry = read(messages, "odom", "nav_msgs/msg/Odometry")
    assert odometry[-1].child_frame_id == "base_footprint"


def test_the_same_seed_is_the_same_world():
    runs = []
    for _ in range(2):
        arm, _ = robot(camera=True)
        stream = arm.messages()
        first = list(itertools.takewhile(lambda message: message.time < 0.1e9, stream))
        arm.grip(["fingers"], 0.8)
        runs.append(first + list(itertools.takewhile(lambda message: message.time < 0.6e9, stream)))
    assert runs[0] == runs[1]
