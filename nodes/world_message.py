"""The world of the core as poise_msgs/WorldState, poise_msgs/Assembly and transforms."""

import numpy as np
from geometry_msgs.msg import TransformStamped
from rclpy.qos import DurabilityPolicy, QoSProfile

from poise.errors import PoiseError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message, object_message
from poise.nodes.estimate_message import time_message
from poise.nodes.runtime import to_message
from poise.world import KnownObject, Whereabouts, World
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import WorldObject, WorldState

GRASP_EVENTS = QoSProfile(depth=10, durability=DurabilityPolicy.TRANSIENT_LOCAL)
"""Of the topic grasp_events: what a hand has done lately, also for who comes later."""


def state_message(world: World, now: int, error: PoiseError | None) -> WorldState:
    """The movable objects, wherever they are; now: ns."""
    message = WorldState(version=world.version, error=to_message(error))
    message.header.frame_id, message.header.stamp = world.frame, time_message(now)
    message.objects = [_object(known) for known in world.objects.values() if not known.item.fixed]
    return message


def _object(known: KnownObject) -> WorldObject:
    return WorldObject(
        state=int(known.where),
        frame_id=known.frame,
        object=object_message(known.item),
        source=int(known.source),
        changed=time_message(known.changed),
        notes=list(known.notes),
    )


def standing_message(world: World, now: int) -> AssemblyMessage | None:
    """What stands, for the topic assembly; None when nothing is fixed; now: ns."""
    if world.assembly is None:
        return None
    message = assembly_message(world.assembly, world.frame)
    message.header.stamp, message.version = time_message(now), world.version
    return message


def transforms_of(world: World, now: int) -> list[TransformStamped]:
    """Of the frames of movable objects: under the frame of the assembly, or that of the hand; now: ns."""
    shown = [each for each in world.objects.values() if not each.item.fixed and each.where is not Whereabouts.LOST]
    if not shown:
        return []
    rotation, place = (
        np.array([getattr(each.item.pose, part) for each in shown]) for part in ("rotation", "translation")
    )
    vectors = Pose(rotation, place).vector.tolist()  # all at once: this runs at the rate of tf
    return [_transform(each.frame, each.item.id, row, now) for each, row in zip(shown, vectors, strict=True)]


def _transform(parent: str, child: str, vector: list[float], now: int) -> TransformStamped:
    transform = TransformStamped(child_frame_id=child)
    transform.header.frame_id, transform.header.stamp = parent, time_message(now)
    shift, turn = transform.transform.translation, transform.transform.rotation
    shift.x, shift.y, shift.z, turn.x, turn.y, turn.z, turn.w = vector
    return transform
