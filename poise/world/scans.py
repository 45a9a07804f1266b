"""What a scan makes of an object: a cylinder where it is one, and else its cleaned surface."""

from poise.assembly import Cylinder, Mesh, RigidObject
from poise.geometry import Pose
from poise.scanning import StandingMesh


def standing_object(name: str, mesh: StandingMesh, pose: Pose, mass: float = 1.0) -> RigidObject:
    """The object with that surface, of some mass, kg, evenly spread.

    The frame of a can is in its centre, with z upwards; that of another object is the surface's.

    Args:
        name: id of the object.
        mesh: its surface.
        pose: of the frame of the surface, in the assembly's.
        mass: kg.
    """
    if (can := mesh.cylinder) is not None:
        return RigidObject(name, Cylinder(can.radius, can.height), pose @ can.pose, mass=mass)
    return RigidObject(name, Mesh(mesh.vertices, mesh.triangles), pose, mass=mass)
