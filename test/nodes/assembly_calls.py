"""Messages for the robustness services: the scenes of test/assembly, pushes and whole requests."""

from collections.abc import Sequence

import numpy as np
from geometry_msgs.msg import Point, Vector3
from rclpy.qos import DurabilityPolicy, QoSProfile
from sensor_msgs.msg import PointField

from poise.assembly import Assembly, Box, RigidObject
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_message
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import Push
from poise_msgs.srv import AssessRobustness, SetAssembly

LATCHED = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL)
FRAME = "tray"


def box(name: str, size: Sequence[float], position: Sequence[float], mass: float = 1.0, fixed: bool = False):
    """A box, upright."""
    return RigidObject(name, Box(tuple(map(float, size))), Pose.from_vector([*position, 0, 0, 0, 1]), fixed, mass)


FLOOR = box("floor", (20, 20, 0.1), (0, 0, -0.05), fixed=True)
CUBE = box("cube", (1, 1, 1), (0, 0, 0.5))
LID = box("lid", (1, 1, 0.2), (0, 0, 1.1), 2.0)


def message(*objects: RigidObject, friction: float = 0.5) -> AssemblyMessage:
    """Objects on the floor."""
    return assembly_message(Assembly((FLOOR, *objects), friction=friction), FRAME)


def wall(rows: int, columns: int) -> AssemblyMessage:
    """Bricks in running bond; the last ones of a row stand by 1 cm."""
    bricks = [
        box(f"b{row}_{column}", (0.2, 0.1, 0.1), (column * 0.2 + row % 2 * 0.09, 0, 0.05 + 0.1 * row), 4.0)
        for row in range(rows)
        for column in range(columns)
    ]
    return message(*bricks)


def push(name: str, point: Sequence[float], direction: Sequence[float]) -> Push:
    """One push; points and directions may be anything that three numbers can say."""
    x, y, z = map(float, point)
    u, v, w = map(float, direction)
    return Push(object=name, point=Point(x=x, y=y, z=z), direction=Vector3(x=u, y=v, z=w))


LOW_PUSH = push("cube", (-0.5, 0, 0.1), (1, 0, 0))


def assess(*pushes: Push, assembly: AssemblyMessage | None = None, **more) -> AssessRobustness.Request:
    """A request; without an assembly it asks about the one that was set."""
    return AssessRobustness.Request(assembly=[] if assembly is None else [assembly], pushes=list(pushes), **more)


def change(operation: int, assembly: AssemblyMessage) -> SetAssembly.Request:
    """A request to set_assembly."""
    return SetAssembly.Request(operation=operation, assembly=assembly)


def replace_by(assembly: AssemblyMessage) -> SetAssembly.Request:
    """A request to set a whole assembly."""
    return change(SetAssembly.Request.REPLACE, assembly)


def records(cloud):
    """The points of a cloud as NumPy records."""
    kinds = {PointField.FLOAT32: "<f4", PointField.FLOAT64: "<f8", PointField.UINT32: "<u4", PointField.INT32: "<i4"}
    names, formats = zip(*((field.name, kinds.get(field.datatype, "u1")) for field in cloud.fields), strict=True)
    offsets = [field.offset for field in cloud.fields]
    return np.frombuffer(
        cloud.data, {"names": names, "formats": formats, "offsets": offsets, "itemsize": cloud.point_step}
    )
