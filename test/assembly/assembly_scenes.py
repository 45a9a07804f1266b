"""Small assemblies with known answers, built in memory."""

import itertools

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, Mesh, RigidObject
from poise.geometry import Pose

G = 9.81
GRAVITY = np.array([0.0, 0.0, -G])


def turned(axis, degrees):
    """Quaternion x y z w of a rotation."""
    half = np.radians(degrees) / 2
    return [*(np.sin(half) * np.asarray(axis, dtype=float)), np.cos(half)]


def pose(position, quaternion=(0, 0, 0, 1)):
    return Pose.from_vector([*position, *quaternion])


def box(name, size, position, mass=1.0, quaternion=(0, 0, 0, 1), **more):
    return RigidObject(name, Box(tuple(map(float, size))), pose(position, quaternion), mass=mass, **more)


def fixed_box(name, size, position, quaternion=(0, 0, 0, 1)):
    return RigidObject(name, Box(tuple(map(float, size))), pose(position, quaternion), fixed=True)


def cylinder(name, radius, length, position, mass=1.0, quaternion=(0, 0, 0, 1), **more):
    return RigidObject(name, Cylinder(radius, length), pose(position, quaternion), mass=mass, **more)


FLOOR = fixed_box("floor", (20, 20, 0.1), (0, 0, -0.05))


def on_floor(*objects, friction=0.5, pairs=()):
    return Assembly((FLOOR, *objects), GRAVITY, friction, tuple(pairs))


def cube(friction=0.5, **more):
    return on_floor(box("cube", (1, 1, 1), (0, 0, 0.5), **more), friction=friction)


def stack(count, friction=0.5, masses=None):
    masses = [1.0] * count if masses is None else masses
    return on_floor(*(box(f"c{i}", (1, 1, 1), (0, 0, 0.5 + i), masses[i]) for i in range(count)), friction=friction)


def table(friction=0.5):
    """Slab on two legs: a cycle through the floor."""
    legs = [box(name, (0.2, 1, 1), (x, 0, 0.5)) for name, x in (("left", -0.9), ("right", 0.9))]
    return on_floor(*legs, box("slab", (2, 1, 0.2), (0, 0, 1.1)), friction=friction)


def wall(rows, bricks, friction=0.5):
    """Bricks in running bond, side by side and touching."""
    objects = []
    for row in range(rows):
        count = bricks - row % 2
        xs = (np.arange(count) - (count - 1) / 2) * 0.2
        objects += [box(f"b{row}_{i}", (0.2, 0.1, 0.1), (x, 0, 0.05 + 0.1 * row)) for i, x in enumerate(xs)]
    return on_floor(*objects, friction=friction)


def between_walls(with_floor, friction=0.5):
    """A cube that exactly fits between two fixed walls."""
    walls = [fixed_box(name, (0.1, 10, 10), (x, 0, 4.95)) for name, x in (("west", -0.55), ("east", 0.55))]
    floor = [FLOOR] if with_floor else []
    height = 0.5 if with_floor else 3.0
    return Assembly((*walls, *floor, box("cube", (1, 1, 1), (0, 0, height))), GRAVITY, friction)


def shells(*parts):
    """One mesh of several closed shells (vertices, triangles)."""
    vertices, triangles, start = [], [], 0
    for points, faces in parts:
        vertices.append(np.asarray(points, dtype=float))
        triangles.append(np.asarray(faces) + start)
        start += len(points)
    return Mesh(np.concatenate(vertices), np.concatenate(triangles))


def hexahedron(corners):
    """Shell of eight corners: four below counter-clockwise from above, and the four over them."""
    quads = [(0, 3, 2, 1), (4, 5, 6, 7), (0, 1, 5, 4), (1, 2, 6, 5), (2, 3, 7, 6), (3, 0, 4, 7)]
    return np.asarray(corners, dtype=float), np.array([[q[0], q[i], q[i + 1]] for q in quads for i in (1, 2)])


def spike(x, y, top, half):
    """Shell of a square pyramid whose tip touches z = 0."""
    base = [[x - half, y - half, top], [x + half, y - half, top], [x + half, y + half, top], [x - half, y + half, top]]
    return np.array([[x, y, 0.0], *base]), np.array([[0, 2, 1], [0, 3, 2], [0, 4, 3], [0, 1, 4], [1, 2, 3], [1, 3, 4]])


def tripod(radius, friction=0.5):
    """A plate on three spikes whose tips lie on a circle of this radius; one tip on the x axis. Weight G."""
    angles = np.radians([0, 120, 240])
    feet = [spike(radius * np.cos(a), radius * np.sin(a), 0.2, 0.05) for a in angles]
    half = 1.5 * radius
    square = [(-half, -half), (half, -half), (half, half), (-half, half)]
    plate = hexahedron([(x, y, 0.2) for x, y in square] + [(x, y, 0.4) for x, y in square])
    mesh = shells(plate, *feet)
    body = RigidObject("tripod", mesh, pose((0, 0, 0)), mass=1.0, com=np.array([0.0, 0.0, 0.3]))
    return on_floor(body, friction=friction)


def arch(thickness, voussoirs=60, friction=10.0):
    """Semicircular arch of mean radius 1, springing from the floor."""
    inner, outer = 1 - thickness / 2, 1 + thickness / 2
    angles = np.linspace(0, np.pi, voussoirs + 1)
    objects = []
    for i, (a, b) in enumerate(itertools.pairwise(angles)):
        ring = [(r * np.cos(t), r * np.sin(t)) for r, t in ((inner, a), (outer, a), (outer, b), (inner, b))]
        corners = [(x, -0.2, z) for x, z in ring] + [(x, 0.2, z) for x, z in ring]
        objects.append(RigidObject(f"v{i}", shells(hexahedron(corners)), pose((0, 0, 0)), mass=1.0))
    return on_floor(*objects, friction=friction)


def ladder(angle=60.0, floor=0.4, wall=0.3, length=2.0, thickness=0.05):
    """A plank leaning on a wall; the line of its two contacts lies on its underside, where its centre of mass is put.

    Returns:
        The assembly, and the point (3,) at a share x of the length from the foot.
    """
    from poise.assembly import FrictionPair

    a = np.radians(angle)
    along, under = np.array([np.cos(a), 0, np.sin(a)]), np.array([np.sin(a), 0, -np.cos(a)])
    centre = length / 2 * along - thickness / 2 * under
    reach = length * np.cos(a)
    plank = box(
        "ladder",
        (length, 0.5, thickness),
        centre,
        quaternion=turned((0, -1, 0), angle),
        com=np.array([0, 0, -thickness / 2]),
    )
    upright = fixed_box("wall", (0.1, 10, 10), (reach + 0.05, 0, 5))
    pairs = (FrictionPair(("ladder", "floor"), floor), FrictionPair(("ladder", "wall"), wall))
    return Assembly((FLOOR, upright, plank), GRAVITY, 0.5, pairs), lambda share: share * length * along
