"""Totes and random objects to pack: boxes alone, or boxes, cans, glued cuboids and truncated pyramids."""

import numpy as np

from benchmarks.placement.scenes import DENSITY, FRICTION, GLUED, box, of_cells
from poise.assembly import Assembly, Cylinder, Mesh, RigidObject
from poise.geometry import Pose
from poise.placement.packing import Container, find_container

WORLDS = ("boxes", "mixed")
DEVELOPMENT, FINAL = 0, 10_000
"""First seeds; the final ones are for published figures only."""
INSIDE = (0.4, 0.3, 0.25)
"""m, of the tote."""
_WALL = 0.01
_SIDES = (0.04, 0.16)
"""m, of boxes."""


def tote(inside: tuple[float, float, float] = INSIDE) -> Assembly:
    """A tote of five fixed boxes on a floor."""
    x, y, z = inside
    t = _WALL
    bodies = [
        box("floor", (2.0, 2.0, 0.1), (0, 0, -0.05)),
        box("bottom", (x + 2 * t, y + 2 * t, t), (0, 0, t / 2)),
        box("left", (t, y + 2 * t, z), (-(x + t) / 2, 0, t + z / 2)),
        box("right", (t, y + 2 * t, z), ((x + t) / 2, 0, t + z / 2)),
        box("front", (x, t, z), (0, -(y + t) / 2, t + z / 2)),
        box("back", (x, t, z), (0, (y + t) / 2, t + z / 2)),
    ]
    fixed = tuple(RigidObject(item.id, item.shape, item.pose, fixed=True) for item in bodies)
    return Assembly(fixed, friction=FRICTION)


def container() -> Container:
    """The room in the tote."""
    return find_container(tote(), None, None)


def objects(world: str, seed: int, count: int = 12) -> list[RigidObject]:
    """Random objects of a world; the same seed gives the same objects."""
    rng = np.random.default_rng([seed, WORLDS.index(world)])
    return [_random(f"object_{k}", world, rng) for k in range(count)]


def _random(name: str, world: str, rng: np.random.Generator) -> RigidObject:
    kind = "box" if world == "boxes" else str(rng.choice(["box", "box", "can", "glued", "pyramid"]))
    if kind == "box":
        return box(name, tuple(rng.uniform(*_SIDES, 3).tolist()), (0, 0, 0))
    if kind == "can":
        shape: Cylinder | Mesh = Cylinder(rng.uniform(0.025, 0.05), rng.uniform(0.05, 0.14))
    elif kind == "glued":
        cells = of_cells(GLUED[str(rng.choice(sorted(GLUED)))])
        shape = Mesh(cells.vertices * rng.uniform(0.6, 1.0), cells.triangles)
    else:
        shape = _truncated_pyramid(rng.uniform(0.06, 0.12, 2), rng.uniform(0.5, 0.9), rng.uniform(0.04, 0.1))
    return RigidObject(name, shape, Pose(np.eye(3), np.zeros(3)), mass=DENSITY * shape.volume)


def _truncated_pyramid(base: np.ndarray, share: float, height: float) -> Mesh:
    """A frustum: its top is a share of its base (x, y)."""
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]]) * base / 2
    vertices = np.vstack([np.column_stack([corners * s, np.full(4, z)]) for s, z in ((1.0, 0.0), (share, height))])
    sides = [(k, (k + 1) % 4, 4 + k) for k in range(4)] + [((k + 1) % 4, 4 + (k + 1) % 4, 4 + k) for k in range(4)]
    return Mesh(vertices, np.array([(0, 2, 1), (0, 3, 2), (4, 5, 6), (4, 6, 7), *sides]))
