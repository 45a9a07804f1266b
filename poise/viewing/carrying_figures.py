"""The figure of a transfer: the arm where it takes the object, on the way, and where it lets go."""

from itertools import pairwise

import coal
import numpy as np
from matplotlib.figure import FigureBase

from poise.assembly import Assembly, Box, Cylinder, RigidObject
from poise.geometry import Pose, rotation_between
from poise.manipulation import Reach, Transfer, TransferPhase, pose_of
from poise.types import Array
from poise.viewing.assembly_picture import stage
from poise.viewing.canvas import PALETTE, Panel

_SIZE = (860, 330)
_BONE, _SHORTEST = 0.037, 0.02
"""m: radius of the rods between joints, and distance of joints from which there is one."""
ROBOT, HELD = "#d3d7dd", "#e3b23c"


def transfer_panel(reach: Reach, transfer: Transfer, placed: RigidObject) -> Panel:
    """Three moments of pick, carry and place."""
    phases = {phase.name: phase for phase in transfer.phases}
    carry = phases["carry"]
    middle = carry.motions[len(carry.motions) // 2] if carry.motions else None
    on_the_way = phases["lift"].motions[-1].position[-1] if middle is None else middle.position[len(middle.times) // 2]
    moments = (
        ("picked up", phases["lift"].motions[0].position[0], phases["lift"]),
        ("carried", on_the_way, carry),
        ("put down", phases["lower"].motions[-1].position[-1], phases["lower"]),
    )

    def draw(figure: FigureBase) -> None:
        for number, (words, q, phase) in enumerate(moments):
            scene = _scene(reach, transfer, q, phase)
            robot = len(scene.objects) - len(reach.around) - 1
            colours = dict.fromkeys(range(robot), ROBOT) | {len(scene.objects) - 1: HELD}
            here = stage(figure, scene, (number / 3, 0, 1 / 3, 0.93), colours)
            here.axes.set_title(words, fontsize=11, color=PALETTE["ink"])

    alt = f"{placed.id} is picked up, carried and put down by the arm."
    return Panel("transfer", alt, draw, _SIZE)


def _scene(reach: Reach, transfer: Transfer, q: Array, phase: TransferPhase) -> Assembly:
    """Robot, surroundings and the object in the hand, as they stand at a configuration."""
    shapes = ((_shape_of(shape), place) for shape, place in reach.arm.shapes(q, phase.opening))
    robot = [
        RigidObject(f"robot {number}", shape, pose_of(place), mass=1.0)
        for number, (shape, place) in enumerate(shapes)
        if shape is not None
    ]
    robot += _bones(reach.arm.joint_origins(q))
    held = reach.arm.tool(q) * transfer.grasp.object_tcp.inverse()
    item = RigidObject(f"{reach.item.id} held", reach.item.shape, pose_of(held), mass=1.0)
    return Assembly((*robot, *reach.around, item))


def _bones(origins: Array) -> list[RigidObject]:
    """Rods from joint to joint: collision shapes leave gaps, which would look like parts that float."""
    bones = []
    for number, (start, end) in enumerate(pairwise(origins)):
        if (length := float(np.linalg.norm(end - start))) > _SHORTEST:
            turn = rotation_between(np.array([0.0, 0.0, 1.0]), (end - start) / length)
            bones.append(
                RigidObject(f"bone {number}", Cylinder(_BONE, length), Pose(turn, (start + end) / 2), mass=1.0)
            )
    return bones


def _shape_of(shape: coal.CollisionGeometry) -> Box | Cylinder | None:
    """A link's shape as an assembly has it; others than boxes and cylinders are left out."""
    if isinstance(shape, coal.Box):
        x, y, z = 2 * np.array(shape.halfSide)
        return Box((float(x), float(y), float(z)))
    return Cylinder(shape.radius, 2 * shape.halfLength) if isinstance(shape, coal.Cylinder) else None
