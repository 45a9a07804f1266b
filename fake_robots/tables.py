"""Random objects on a table beside a tray: the world in which `poise loop` works when no scene is given."""

from pathlib import Path

import numpy as np

from poise.assembly import Assembly, Box, Cylinder, Mesh, RigidObject, write_scene
from poise.errors import ErrorCode, NoAnswerError
from poise.files import write_whole
from poise.geometry import Pose, rotation_about
from poise.types import Array, Indices

FRICTION = 0.5
TOP = 0.4
"""m over the floor: the upper faces of table and tray, and the root link of the arm."""
_TABLE, _TRAY = (0.40, -0.42, 0.46, 0.36), (0.5, 0.06, 0.4, 0.4)
"""m: x, y of the middle, lengths along x and y; the arm stands at the origin."""
_THICK = 0.02
_APART = 0.11
"""m between the middles of two objects: the hand fits between them."""
_EDGE = 0.07
"""m from an edge of the table to the middle of an object."""
_REACH = 0.66
"""m from the arm to the middle of an object."""
_DENSITY = (500.0, 4000.0)
"""kg/m3, from wood to stone."""
_LUMP = 0.35
"""Largest share of the mass in a lump beside the middle."""
_TRIES = 2000


def random_table(count: int, rng: np.random.Generator, folder: Path) -> Path:
    """Write the scene of a table with unknown objects: boxes, cylinders and L-shapes with offset centres of mass.

    Args:
        count: of the objects, 1 to 8.
        rng: draws them.
        folder: for `truth.yaml` and the meshes of the L-shapes.

    Returns:
        The path of the scene. The arm stands at its origin, `TOP` over the floor; table and tray are fixed.

    Raises:
        NoAnswerError: NO_PLACEMENT when so many objects do not fit on the table.
    """
    objects = [_plate("table", _TABLE), _plate("tray", _TRAY)]
    for number, place in enumerate(_places(count, rng), start=1):
        objects.append(_object(f"truth_{number}", place, rng, folder))
    path = folder / "truth.yaml"
    write_scene(Assembly(tuple(objects), friction=FRICTION), path)
    return path


def _plate(name: str, span: tuple[float, float, float, float]) -> RigidObject:
    x, y, length, width = span
    place = Pose.from_vector([x, y, TOP - _THICK / 2, 0, 0, 0, 1])
    return RigidObject(name, Box((length, width, _THICK)), place, fixed=True)


def _places(count: int, rng: np.random.Generator) -> list[Array]:
    """(2,) m each, on the table, with room for the hand between them."""
    middle, half = np.array(_TABLE[:2]), np.array(_TABLE[2:]) / 2 - _EDGE
    for _ in range(_TRIES):
        found: list[Array] = []
        for place in middle + rng.uniform(-1, 1, (20 * count, 2)) * half:
            near = any(np.linalg.norm(place - other) < _APART for other in found)
            if not near and np.linalg.norm(place) < _REACH:
                found.append(place)
            if len(found) == count:
                return found
    raise NoAnswerError(ErrorCode.NO_PLACEMENT, f"{count} objects do not fit on the table; ask for fewer")


def _object(name: str, place: Array, rng: np.random.Generator, folder: Path) -> RigidObject:
    """One object, standing upright."""
    kind = rng.integers(3)
    height = rng.uniform(0.04, 0.09)
    if kind == 0:
        shape: Box | Cylinder | Mesh = Box((rng.uniform(0.03, 0.07), rng.uniform(0.03, 0.07), height))
    elif kind == 1:
        shape = Cylinder(rng.uniform(0.018, 0.033), height)
    else:
        shape = _angle(rng.uniform(0.045, 0.07, 2), rng.uniform(0.02, 0.03), height, folder / f"{name}.obj")
    turn = rotation_about(np.array([0.0, 0.0, 1.0]), rng.uniform(-np.pi, np.pi))
    pose = Pose(turn, np.array([*place, TOP + height / 2]))
    mass = float(rng.uniform(*_DENSITY) * shape.volume)
    return _weighted(RigidObject(name, shape, pose, mass=mass), rng)


def _angle(legs: Array, thick: float, height: float, path: Path) -> Mesh:
    """A prism with the outline of an L, with its middle height at z = 0; written to a file, which a scene names."""
    a, b = legs
    outline = np.array([[0, 0], [a, 0], [a, thick], [thick, thick], [thick, b], [0, b]]) - legs / 2
    vertices = np.vstack([np.column_stack([outline, np.full(6, z)]) for z in (-height / 2, height / 2)])
    side = [(i, (i + 1) % 6) for i in range(6)]
    cover = [(0, 1, 2), (0, 2, 3), (0, 3, 5), (3, 4, 5)]
    triangles: Indices = np.array(
        [(c, b, a) for a, b, c in cover]
        + [(a + 6, b + 6, c + 6) for a, b, c in cover]
        + [(i, j, j + 6) for i, j in side]
        + [(i, j + 6, i + 6) for i, j in side]
    )
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in vertices] + [f"f {a} {b} {c}" for a, b, c in triangles + 1]
    write_whole(path, ("\n".join(lines) + "\n").encode())
    return Mesh(vertices, triangles, source=path.name)


def _weighted(item: RigidObject, rng: np.random.Generator) -> RigidObject:
    """The object with a share of its mass in a lump, so that its centre of mass is not its middle."""
    size = np.ptp(item.shape.polyhedron.vertices, axis=0)
    share = rng.uniform(0.0, _LUMP)
    middle = np.asarray(item.shape.centroid)
    lump = middle + rng.uniform(-0.25, 0.25, 3) * size
    if isinstance(item.shape, Mesh):
        lump = middle + rng.uniform(-0.1, 0.1, 3) * size  # it stays inside the L
    com = (1 - share) * middle + share * lump
    even = item.pose.rotation.T @ item.inertia_in_world @ item.pose.rotation
    inertia = (1 - share) * (even + item.mass * _steiner(middle - com)) + share * item.mass * _steiner(lump - com)
    return RigidObject(item.id, item.shape, item.pose, mass=item.mass, com=com, inertia=inertia)


def _steiner(offset: Array) -> Array:
    """(3, 3) m2: inertia per kg of a point at an offset (3,)."""
    return np.asarray(offset @ offset * np.eye(3) - np.outer(offset, offset))
