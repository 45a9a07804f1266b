"""What a hand did with an object, on the topic grasp_events; and what it holds, from the topic world."""

import math

from rclpy.node import Node

from poise.assembly import RigidObject
from poise.errors import ErrorCode, InputError
from poise.geometry import Pose
from poise.manipulation import Grip
from poise.nodes.assembly_message import object_message, pose_message
from poise.nodes.runtime import LATCHED, guarded
from poise.nodes.world_message import GRASP_EVENTS
from poise.recording import stamp_of
from poise_msgs.msg import GraspEvent, WorldObject, WorldState


class HandEvents:
    """Publishes grasp_events, and hears them and world.

    Args:
        node: whose hand it is.
        tool_frame: of the hand.
    """

    def __init__(self, node: Node, tool_frame: str) -> None:
        self._node, self.tool_frame = node, tool_frame
        self._world: WorldState | None = None
        self._last: GraspEvent | None = None
        self._events = node.create_publisher(GraspEvent, "grasp_events", GRASP_EVENTS)
        node.create_subscription(GraspEvent, "grasp_events", guarded(node, self._on_event), GRASP_EVENTS)
        node.create_subscription(WorldState, "world", guarded(node, self._on_world), LATCHED)

    def _on_world(self, message: WorldState) -> None:
        self._world = message

    def _on_event(self, message: GraspEvent) -> None:
        if self._last is None or stamp_of(message) >= stamp_of(self._last):
            self._last = message

    def grip(self, name: str) -> Grip | None:
        """How the fingers hold an object; None: not known."""
        last = self._last
        known = last is not None and (last.event, last.id) == (GraspEvent.GRASPED, name)
        return Grip(last.opening, last.kept_open) if known and math.isfinite(last.kept_open) else None

    def known(self, name: str) -> WorldObject | None:
        """An object of the world."""
        return next((each for each in self._objects if each.object.id == name), None)

    @property
    def held(self) -> WorldObject | None:
        """What the hand holds, as the world says."""
        return next((each for each in self._objects if each.state == WorldObject.HELD), None)

    def require_held(self, name: str) -> WorldObject:
        """What the hand holds; a name that is not empty must be its id.

        Raises:
            InputError: NOT_HELD.
        """
        held = self.held
        if held is None or name not in ("", held.object.id):
            what = "nothing" if held is None else held.object.id
            raise InputError(ErrorCode.NOT_HELD, f"the hand holds {what}, not {name or 'an object'}: pick it first")
        return held

    @property
    def _objects(self) -> list[WorldObject]:
        return [] if self._world is None else list(self._world.objects)

    def grasped(
        self,
        item: RigidObject,
        pose_tool_object: Pose,
        grip: Grip | None,
        mass: float = math.nan,
        std: float = math.nan,
    ) -> None:
        """The fingers closed on an object; mass, std: kg, by its lift."""
        message = self._event(GraspEvent.GRASPED, item.id, self.tool_frame)
        message.pose, message.object = pose_message(pose_tool_object), [object_message(item)]
        message.mass, message.mass_std = mass, std
        if grip is not None:
            message.opening, message.kept_open = grip
        self._events.publish(message)

    def released(self, name: str, pose: Pose, frame: str) -> None:
        """The fingers opened, and the object stands there."""
        message = self._event(GraspEvent.RELEASED, name, frame)
        message.pose = pose_message(pose)
        self._events.publish(message)

    def lost(self, name: str) -> None:
        """The hand is empty, and where the object is, is not known."""
        self._events.publish(self._event(GraspEvent.LOST, name, self.tool_frame))

    def _event(self, event: int, name: str, frame: str) -> GraspEvent:
        unknown = dict.fromkeys(("mass", "mass_std", "opening", "kept_open"), math.nan)
        message = GraspEvent(event=event, id=name, **unknown)
        message.header.stamp, message.header.frame_id = self._node.get_clock().now().to_msg(), frame
        return message
