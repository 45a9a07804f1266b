"""Round bodies on floors, in grooves, between chocks and on each other, for tests of rolling."""

import assembly_scenes as scenes
import numpy as np
import trimesh

from poise.assembly import Assembly, Mesh, RigidObject, Sphere

R = 0.05
LYING = scenes.turned((1, 0, 0), 90)  # the axis of a cylinder along -y


def can(name="can", x=0.0, z=R, **more):
    return scenes.cylinder(name, R, 0.2, (x, 0, z), quaternion=LYING, **more)


def ball(name="ball", x=0.0, z=R, **more):
    return RigidObject(name, Sphere(R), scenes.pose((x, 0, z)), mass=1.0, **more)


KINDS = {"can": can, "ball": ball}


def chocks(height, gap=0.0, sides=(-1, 1)):
    """Fixed blocks beside a round body at the origin, whose edges touch it."""
    reach = np.sqrt(R**2 - (R - height) ** 2) + gap
    return [scenes.fixed_box(f"chock{s}", (0.05, 0.4, height), (s * (reach + 0.025), 0, height / 2)) for s in sides]


def groove(degrees, friction=0.5, body=can):
    """A round body on two planes that rise to both sides of x = 0."""
    walls = []
    for name, side in (("left", -1), ("right", 1)):
        angle = np.radians(degrees)
        normal = np.array([-side * np.sin(angle), 0, np.cos(angle)])
        along = np.array([side * np.cos(angle), 0, np.sin(angle)])
        middle = 0.1 * along - 0.025 * normal
        walls.append(scenes.fixed_box(name, (0.2, 0.5, 0.05), middle, scenes.turned((0, 1, 0), -side * degrees)))
    return Assembly((*walls, body(z=R / np.cos(np.radians(degrees)))), scenes.GRAVITY, friction)


def mesh_on_floor(surface, down, com=None):
    """A mesh that lies on the facet whose normal is nearest to a direction, as far as it is about -y: see `facing`."""
    surface = surface.copy()
    surface.apply_transform(trimesh.geometry.align_vectors(down, [0, 0, -1]))
    mesh = Mesh(np.asarray(surface.vertices), np.asarray(surface.faces, dtype=np.int64))
    low = -float(mesh.vertices[:, 2].min())
    return scenes.on_floor(RigidObject("body", mesh, scenes.pose((0, 0, low)), mass=1.0, com=com))


def prism(sides):
    """A cylinder of flat sides along y, on one of them; its half width is R sin(pi / sides)."""
    surface = trimesh.creation.cylinder(radius=R, height=0.2, sections=sides)
    return mesh_on_floor(surface, [np.cos(np.pi / sides), np.sin(np.pi / sides), 0])
