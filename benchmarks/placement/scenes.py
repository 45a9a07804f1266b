"""The nine scenes, the ten objects and the bowls; `python -m benchmarks.placement.scenes` writes docs/scenes/placement.

The first six are those of thesis Fig. 5.8 in kind, at the size of a robot's table: cubes of 0.1 m. Slant, Balance and
Cantilever are harder: a slope near the angle of friction, a beam on a narrow pivot, a plank that a weight holds.
"""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import shapely

from poise.assembly import Assembly, Box, Mesh, RigidObject, write_scene
from poise.files import write_whole
from poise.geometry import Pose
from poise.types import Array

FOLDER = Path(__file__).resolve().parents[2] / "docs" / "scenes" / "placement"
DENSITY = 415.0
"""kg/m3, of basswood (thesis section 5.7)."""
FRICTION = 0.5

# Cuboids of the ten objects, in cells of 2.5 cm: (x, y, z of a corner, and of the opposite one).
Cuboid = tuple[int, int, int, int, int, int]
GLUED: dict[str, tuple[Cuboid, ...]] = {
    "a": ((0, 0, 0, 4, 2, 2), (0, 0, 2, 2, 2, 4)),
    "b": ((0, 0, 0, 6, 1, 1), (5, 0, 1, 6, 1, 3)),
    "c": ((0, 0, 0, 6, 2, 1), (2, 0, 1, 4, 2, 2)),
    "d": ((0, 0, 0, 7, 1, 1), (3, 1, 0, 4, 3, 1)),
    "e": ((0, 0, 0, 3, 3, 3), (3, 1, 0, 5, 2, 1)),
    "f": ((0, 0, 0, 1, 3, 4), (1, 0, 0, 4, 3, 1), (4, 0, 0, 5, 3, 4)),
    "g": ((0, 0, 0, 2, 2, 5), (2, 0, 3, 4, 2, 5)),
    "h": ((1, 0, 0, 3, 2, 4), (0, 0, 4, 4, 2, 5)),
    "i": ((0, 0, 0, 6, 2, 1), (0, 2, 0, 2, 4, 1), (4, 2, 0, 6, 4, 1)),
    "j": ((0, 0, 0, 4, 4, 1), (0, 0, 1, 2, 2, 2), (0, 0, 2, 1, 1, 4)),
}
CELL = 0.025


def cube() -> RigidObject:
    """What is placed in all nine scenes."""
    return box("placed", (0.1, 0.1, 0.1), (0, 0, 0))


def scene(name: str, stretch: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Assembly:
    """A scene by name. Stretched along its axes it is another one of its kind, to develop on."""
    floor = replace(box("floor", (1.2, 1.2, 0.02), (0, 0, -0.01)), fixed=True, mass=0.0)
    return Assembly((floor, *(_stretched(item, np.array(stretch)) for item in SCENES[name]())), friction=FRICTION)


def glued(name: str) -> RigidObject:
    """One of the ten objects of glued cuboids, at the origin."""
    return solid(name, of_cells(GLUED[name]), (0, 0, 0))


def bowl(vertices: int) -> RigidObject:
    """A hemispherical shell, 0.15 m wide, 1 cm thick, on the flat facet at its bottom, of about so many vertices."""
    around = max(8, 2 * round(np.sqrt(vertices / 2) / 2))
    rings = max(3, round(vertices / around / 2))
    bottom = 0.6
    profile = [(r, t) for r, t in ((0.075, a) for a in np.linspace(bottom, np.pi / 2, rings))]
    profile += [(0.065, a) for a in np.linspace(np.pi / 2, bottom, rings)]
    # About a vertical axis; the inner surface ends at the same height above the outer as the shell is thick.
    rim = [(radius * np.sin(angle), -radius * np.cos(angle)) for radius, angle in profile]
    low = 0.075 * np.cos(bottom)
    return solid("bowl", revolved(np.array(rim), around), (0, 0, low))


def box(name: str, size: tuple[float, float, float], centre: tuple[float, float, float]) -> RigidObject:
    pose = Pose(np.eye(3), np.array(centre, dtype=float))
    return RigidObject(name, Box(size), pose, mass=DENSITY * float(np.prod(size)))


def solid(name: str, mesh: Mesh, place: tuple[float, float, float]) -> RigidObject:
    return RigidObject(name, mesh, Pose(np.eye(3), np.array(place, dtype=float)), mass=DENSITY * mesh.volume)


def prism(profile: list[tuple[float, float]], depth: float) -> Mesh:
    """A polygon (x, z), counter-clockwise seen from -y, drawn along y."""
    flat = np.array(profile)
    n = len(flat)
    vertices = np.concatenate(
        [np.column_stack([flat[:, 0], np.full(n, y), flat[:, 1]]) for y in (-depth / 2, depth / 2)]
    )
    parts = shapely.get_parts(shapely.constrained_delaunay_triangles(shapely.Polygon(flat)))
    corners = shapely.get_coordinates(parts).reshape(-1, 4, 2)[:, :3]
    front = np.linalg.norm(corners[:, :, None] - flat, axis=3).argmin(axis=2)
    a, b, c = np.moveaxis(flat[front], 1, 0)
    clockwise = (b - a)[:, 0] * (c - a)[:, 1] < (b - a)[:, 1] * (c - a)[:, 0]
    front[clockwise] = front[clockwise][:, ::-1]
    k = np.arange(n)
    after = (k + 1) % n
    sides = [np.column_stack([k, k + n, after]), np.column_stack([after, k + n, after + n])]
    return Mesh(vertices, np.concatenate([front, front[:, ::-1] + n, *sides]))


def pyramid(base: float, height: float) -> Mesh:
    half = base / 2
    corners = [(-half, -half, 0), (half, -half, 0), (half, half, 0), (-half, half, 0), (0, 0, height)]
    sides = [(k, (k + 1) % 4, 4) for k in range(4)]
    return Mesh(np.array(corners, dtype=float), np.array([(0, 2, 1), (0, 3, 2), *sides]))


def of_cells(cuboids: tuple[Cuboid, ...]) -> Mesh:
    """The closed surface of glued cuboids."""
    filled = np.zeros((9, 9, 9), dtype=bool)
    for x0, y0, z0, x1, y1, z1 in cuboids:
        filled[x0 + 1 : x1 + 1, y0 + 1 : y1 + 1, z0 + 1 : z1 + 1] = True
    quads = []
    for axis in range(3):
        for sign in (1, -1):
            side = np.argwhere(filled & ~np.roll(filled, -sign, axis=axis))
            corner = side.copy()
            corner[:, axis] += sign > 0
            u, v = np.eye(3, dtype=int)[(axis + 1) % 3], np.eye(3, dtype=int)[(axis + 2) % 3]
            ring = (0 * u, u, u + v, v) if sign > 0 else (0 * u, v, u + v, u)
            quads += [corner + step for step in ring]
    corners = np.stack([np.concatenate(quads[k::4]) for k in range(4)], axis=1)
    points, index = np.unique(corners.reshape(-1, 3), axis=0, return_inverse=True)
    index = index.reshape(-1, 4)
    triangles = np.concatenate([index[:, [0, 1, 2]], index[:, [0, 2, 3]]])
    return Mesh(CELL * (points - 1.0), triangles)


def revolved(profile: Array, around: int) -> Mesh:
    """An open profile (K, 2) of radius and height about z, both of whose ends are closed by flat discs."""
    angles = 2 * np.pi * np.arange(around) / around
    rings = [np.column_stack([r * np.cos(angles), r * np.sin(angles), np.full(around, z)]) for r, z in profile]
    ends = [[0, 0, profile[0, 1]], [0, 0, profile[-1, 1]]]
    vertices = np.concatenate([*rings, np.array(ends)])
    i = np.arange(around)
    j = (i + 1) % around
    triangles = []
    for k in range(len(profile) - 1):
        low, high = k * around, (k + 1) * around
        triangles += [np.column_stack([low + i, low + j, high + j]), np.column_stack([low + i, high + j, high + i])]
    first, last, top = len(vertices) - 2, len(vertices) - 1, (len(profile) - 1) * around
    triangles += [
        np.column_stack([j, i, np.full(around, first)]),
        np.column_stack([top + i, top + j, np.full(around, last)]),
    ]
    return Mesh(vertices, np.concatenate(triangles))


def _pyramids() -> list[RigidObject]:
    mesh, far = pyramid(0.06, 0.1), 0.07 / np.sqrt(3)
    places = [(far * np.cos(a), far * np.sin(a), 0.0) for a in np.array([1.0, 5.0, 9.0]) * np.pi / 6]
    return [solid(f"pyramid_{k}", mesh, place) for k, place in enumerate(places)]


def _sawteeth() -> list[RigidObject]:
    teeth, pitch = 5, 0.06
    tops = [p for k in range(teeth) for p in ((pitch * (k + 0.8), 0.09), (pitch * (k + 1), 0.06))]
    profile = [(0.0, 0.0), (pitch * teeth, 0.0), *reversed(tops), (0.0, 0.06)]
    return [solid("saw", prism([(x - pitch * teeth / 2, z) for x, z in profile], 0.16), (0, 0, 0))]


def _canyon() -> list[RigidObject]:
    left = prism([(-0.16, 0.0), (-0.015, 0.0), (-0.015, 0.015), (-0.16, 0.16)], 0.2)
    right = prism([(0.015, 0.0), (0.16, 0.0), (0.16, 0.16), (0.015, 0.015)], 0.2)
    return [solid("left", left, (0, 0, 0)), solid("right", right, (0, 0, 0))]


def _cantilever() -> list[RigidObject]:
    weight = replace(box("weight", (0.04, 0.08, 0.06), (-0.06, 0, 0.15)), mass=0.4)
    return [box("block", (0.1, 0.1, 0.1), (-0.05, 0, 0.05)), box("plank", (0.3, 0.08, 0.02), (0.07, 0, 0.11)), weight]


SCENES: dict[str, Callable[[], list[RigidObject]]] = {
    "cube": lambda: [box("cube", (0.1, 0.1, 0.1), (0, 0, 0.05))],
    "stack": lambda: [box(f"cube_{k}", (0.1, 0.1, 0.1), (0, 0, 0.05 + 0.1 * k)) for k in range(4)],
    "table": lambda: [box("leg", (0.06, 0.06, 0.15), (0, 0, 0.075)), box("slab", (0.3, 0.3, 0.015), (0, 0, 0.1575))],
    "pyramids": _pyramids,
    "sawteeth": _sawteeth,
    "canyon": _canyon,
    # 24 degrees, where 26.6 would slip.
    "slant": lambda: [solid("wedge", prism([(-0.1, 0), (0.1, 0), (0.1, 0.139), (-0.1, 0.05)], 0.2), (0, 0, 0))],
    "balance": lambda: [box("pivot", (0.04, 0.06, 0.1), (0, 0, 0.05)), box("beam", (0.4, 0.06, 0.02), (0, 0, 0.11))],
    "cantilever": _cantilever,
}


def _stretched(item: RigidObject, factors: Array) -> RigidObject:
    pose = Pose(item.pose.rotation, item.pose.translation * factors)
    shape = item.shape
    if isinstance(shape, Box):
        stretched: Box | Mesh = Box(tuple((np.array(shape.size) * factors).tolist()))
    else:
        stretched = Mesh(shape.polyhedron.vertices * factors, shape.polyhedron.triangles)
    return replace(item, shape=stretched, pose=pose, mass=item.mass * float(factors.prod()))


def write(folder: Path = FOLDER) -> None:
    """Write all scenes and objects with their meshes."""
    folder.mkdir(parents=True, exist_ok=True)
    for name in SCENES:
        assembly = scene(name)
        objects = tuple(_with_file(item, folder, name) for item in assembly.objects)
        write_scene(replace(assembly, objects=objects), folder / f"{name}.yaml")
    floor = scene("cube").objects[0]
    for name in GLUED:
        item = _with_file(glued(name), folder, "glued")
        write_scene(Assembly((floor, item), friction=FRICTION), folder / f"glued_{name}.yaml")


def _with_file(item: RigidObject, folder: Path, prefix: str) -> RigidObject:
    """The same object, its mesh written beside the scene."""
    if isinstance(item.shape, Box):
        return item
    mesh = item.shape.polyhedron
    file = f"{prefix}_{item.id.split('_')[0]}.obj"
    lines = [f"v {x:.9g} {y:.9g} {z:.9g}" for x, y, z in mesh.vertices]
    lines += [f"f {a} {b} {c}" for a, b, c in mesh.triangles + 1]
    write_whole(folder / file, ("\n".join(lines) + "\n").encode())
    return replace(item, shape=Mesh(mesh.vertices, mesh.triangles, source=file))


if __name__ == "__main__":
    write()
