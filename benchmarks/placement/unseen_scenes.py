"""Scenes of kitchens, racks, drawers, totes and pallets with one place left, or none, turned by any angle.

Each scene is built around the object in its place (the witness), which shows that there is a place; then the object is
taken out. In impossible ones every room is narrower than the object. Nothing here is used by the planner's own
benchmark (`scenes`).
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
import shapely

from benchmarks.placement.scenes import prism, revolved
from poise.assembly import Assembly, Box, Cylinder, Mesh, RigidObject
from poise.assembly.scene import Shape
from poise.baselines.placement.engine import Engine
from poise.geometry import Pose, rotation_about
from poise.placement import KeptFree, Options, Upright
from poise.types import Array

Z = np.array([0.0, 0.0, 1.0])
_FAR = 9.0
_TURNS = [np.eye(3), rotation_about(np.array([1.0, 0, 0]), np.pi / 2), rotation_about(np.array([0, 1.0, 0]), np.pi / 2)]


@dataclass(frozen=True, eq=False)
class Task:
    """What is asked.

    Args:
        kind: of scene.
        seed: of it.
        assembly: what is there, without the object.
        item: the object, where it was when the scene was made.
        options: of the request.
        possible: there is a place.
    """

    kind: str
    seed: int
    assembly: Assembly
    item: RigidObject
    options: Options
    possible: bool


class Scene:
    """Bodies that are collected, in a frame that is turned about the vertical at the end."""

    def __init__(self, rng: np.random.Generator) -> None:
        self.rng, self.bodies = rng, list[RigidObject]()
        self.friction = round(float(rng.uniform(0.35, 0.7)), 3)

    def fix(self, size: Sequence[float], low: Sequence[float]) -> None:
        """A fixed box, by its least corner."""
        pose = Pose(np.eye(3), np.asarray(low) + np.asarray(size) / 2)
        self.bodies.append(RigidObject(f"fixed_{len(self.bodies)}", _box(size), pose, fixed=True))

    def add(self, shape: Shape, place: Sequence[float], rotation: Array | None = None, name: str = "") -> None:
        """A body that moves, by the place of its frame."""
        density = float(self.rng.uniform(150, 1200))
        pose = Pose(np.eye(3) if rotation is None else rotation, np.array(place, dtype=float))
        name = name or f"body_{len(self.bodies)}"
        self.bodies.append(RigidObject(name, shape, pose, mass=density * shape.volume))

    def stand(self, shape: Shape, x: float, y: float, z: float, yaw: float = 0.0, name: str = "", k: int = 0) -> None:
        """A body with its lowest point at z, its middle over x, y; k: which of its axes points up."""
        rotation = rotation_about(Z, yaw) @ _TURNS[k]
        corners = shape.polyhedron.vertices @ rotation.T
        low, high = corners.min(axis=0), corners.max(axis=0)
        self.add(shape, np.array([x, y, z]) - [*((low + high) / 2)[:2], low[2]], rotation, name)

    def task(self, kind: str, seed: int, possible: bool = True, looks: Sequence = (), on: str = "any") -> Task:
        """All of it turned and moved; the body named `item` is taken out."""
        turn = rotation_about(Z, float(self.rng.uniform(0, 2 * np.pi)))
        shift = np.array([*self.rng.uniform(-1, 1, 2), 0.0])
        bodies = [replace(b, pose=Pose(turn @ b.pose.rotation, turn @ b.pose.translation + shift)) for b in self.bodies]
        item = next(b for b in bodies if b.id == "item")
        rest = Assembly(tuple(b for b in bodies if b.id != "item"), friction=self.friction)
        return Task(kind, seed, rest, item, Options(on=on, looks=tuple(looks)), possible)


def _box(size: Sequence[float]) -> Box:
    x, y, z = (float(v) for v in size)
    return Box((x, y, z))


def _upright(*axes: str) -> tuple[str, Upright]:
    return "upright", Upright(axes or ("z",))


def _below(height: float) -> tuple[str, KeptFree]:
    """Nothing reaches above a height."""
    return "is over the rim", KeptFree(np.array([-_FAR, -_FAR, height]), np.array([_FAR, _FAR, _FAR]))


def _elbow(x: float, y: float, z: float, thick: float) -> Mesh:
    """An L of legs x and z, drawn along y."""
    return prism([(0, 0), (x, 0), (x, thick), (thick, thick), (thick, z), (0, z)], y)


def _tee(x: float, y: float, z: float, thick: float) -> Mesh:
    """A T that stands on its bar, drawn along y."""
    low, high = (x - thick) / 2, (x + thick) / 2
    return prism([(0, 0), (x, 0), (x, thick), (high, thick), (high, z), (low, z), (low, thick), (0, thick)], y)


def _cup(rng: np.random.Generator, slope: float = 0.0) -> Mesh:
    """A mug without a handle, or a bowl with a slope: wider by its share at the rim."""
    radius, height, wall = rng.uniform([0.03, 0.06, 0.004], [0.045, 0.11, 0.006])
    if slope:
        radius, height = radius * 0.8, height * 0.6
    rim = radius * (1 + slope)
    profile = [(radius, 0), (rim, height), (rim - wall, height), (radius - wall, wall)]
    return revolved(np.array(profile), 10)


def _random_shape(rng: np.random.Generator) -> Shape:
    x, y, z = rng.uniform(0.04, 0.12, 3).tolist()
    kind = int(rng.integers(6))
    if kind < 2:
        return Box((x, y, z))
    if kind == 2:
        return Cylinder(x / 3, y)
    if kind == 3:
        return _elbow(max(x, 0.06), y, max(z, 0.06), 0.02)
    return _tee(max(x, 0.07), y, max(z, 0.06), 0.02) if kind == 4 else _cup(rng)


def _wide(rng: np.random.Generator, possible: bool) -> float:
    """m by which a room is wider than what belongs in it."""
    return float(rng.uniform(0.004, 0.012) if possible else -rng.uniform(0.008, 0.014))


def dish_rack(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Plates on edge on two rails, between tines; one slot is empty (or all of them are too narrow)."""
    scene, slots = Scene(rng), int(rng.integers(4, 8))
    radius, thick, half = rng.uniform([0.07, 0.008, 0.03], [0.11, 0.014, 0.045])
    pitch, tine, width = thick + 0.012 + rng.uniform(0, 0.01), 0.005, rng.uniform(0.006, 0.01)
    depth = np.sqrt(radius**2 - half**2) + rng.uniform(0.004, 0.02)
    for side in (-1, 1):
        scene.fix((slots * pitch + tine, width, 0.02), (0, side * half - (0 if side > 0 else width), depth - 0.02))
        for k in range(slots + 1):
            scene.fix((tine, width, 0.09), (k * pitch, side * half - (0 if side > 0 else width), depth))
    free = int(rng.integers(slots))
    tilt = rotation_about(np.array([0, 1.0, 0]), np.pi / 2)
    for k in range(slots):
        if k != free and rng.random() < 0.3:
            continue
        middle = (k + 0.5) * pitch + tine / 2
        scene.add(
            Cylinder(float(radius), float(thick)),
            (middle, 0, depth + np.sqrt(radius**2 - half**2)),
            tilt,
            "item" * (k == free),
        )
    looks = [("lies", Upright(("x", "-x", "y", "-y"), tolerance=25.0))] if rng.random() < 0.5 else []
    return _settled(scene.task("dish rack", seed, looks=looks))


def spice_shelf(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Jars between two boards with little headroom, in one or two rows; one is missing."""
    scene, height = Scene(rng), float(rng.uniform(0.08, 0.13))
    radius, deep = float(rng.uniform(0.02, 0.032)), int(rng.integers(1, 3))
    count, gap = int(rng.integers(4, 8)), _wide(rng, possible)
    headroom = float(rng.uniform(0.006, 0.02))
    x0, free = 0.0, int(rng.integers(count))
    pitch = 2 * radius + 0.002
    y1 = deep * pitch + 0.004
    for k in range(count):
        for row in range(deep):
            y = (row + 0.5) * pitch + 0.001
            if k == free and row == 0:
                scene.stand(Cylinder(radius, height), x0 + pitch / 2 + gap / 2, y, 0, name="item")
            else:
                wide = x0 + pitch / 2 + (gap / 2 if k == free else 0)
                narrow = min(gap, 0.0) / 2 if k == free else 0.0
                scene.stand(Cylinder(radius - 5e-4 + narrow, height - float(rng.uniform(0, 0.02))), wide, y, 0)
        x0 += pitch + (gap if k == free else 0)
    for z in (-0.012, height + headroom):
        scene.fix((x0 + 0.024, y1 + 0.012, 0.012), (-0.012, 0, z))
    for x in (-0.012, x0):
        scene.fix((0.012, y1, height + headroom), (x, 0, 0))
    scene.fix((x0 + 0.024, 0.012, height + headroom), (-0.012, y1, 0))
    if not possible:  # else a jar may overhang the front
        scene.fix((x0 + 0.024, 0.012, height + headroom), (-0.012, -0.012, 0))
    top = [] if possible else [_below(height + headroom)]
    return scene.task("spice shelf", seed, possible, [_upright("z", "-z"), *top], "fixed" if not possible else "any")


def drawer(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Compartments between thin dividers, all of them full but one (or all too small)."""
    scene, wall = Scene(rng), 0.004
    columns, rows, depth = int(rng.integers(2, 5)), int(rng.integers(1, 4)), float(rng.uniform(0.05, 0.09))
    wide, deep = rng.uniform(0.06, 0.14, columns), rng.uniform(0.06, 0.14, rows)
    xs, ys = np.append(0, np.cumsum(wide + wall)), np.append(0, np.cumsum(deep + wall))
    scene.fix((xs[-1] + wall, ys[-1] + wall, 0.01), (0, 0, -0.01))
    for x in xs:
        scene.fix((wall, ys[-1] + wall, depth), (x, 0, 0))
    for y in ys:
        for k in range(columns):
            scene.fix((wide[k], wall, depth), (xs[k] + wall, y, 0))
    free = int(rng.integers(columns * rows))
    for k in range(columns * rows):
        i, j = divmod(k, rows)
        middle = xs[i] + wall + wide[i] / 2, ys[j] + wall + deep[j] / 2
        size = wide[i] - _wide(rng, True), deep[j] - _wide(rng, True)
        if k == free and possible:
            tall = float(rng.uniform(0.6, 0.95)) * depth
            shape: Shape = _box((*size, tall)) if rng.random() < 0.5 else _elbow(size[0], size[1], tall, 0.015)
            scene.stand(shape, *middle, 0, name="item")
        elif rng.random() < 0.8 or not possible:
            share = float(rng.uniform(0.5, 1.0)) if possible else 1.0
            scene.stand(_box((size[0], share * size[1], rng.uniform(0.5, 0.95) * depth)), *middle, 0)
    if not possible:
        scene.stand(_box(np.full(3, 0.6 * depth)), _FAR, 0, 0, name="item")
    return scene.task("drawer", seed, possible, [_below(depth)], "fixed")


def crate(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """A board that leans on a wall of a crate, and boxes on its floor; the object was among these."""
    scene = Scene(rng)
    x, y, z = rng.uniform([0.3, 0.25, 0.2], [0.5, 0.4, 0.3])
    _walls(scene, x, y, z)
    thick, long, width = rng.uniform([0.008, 0.15, 0.1], [0.02, 0.19, 0.15])
    lean = rotation_about(np.array([0, 1.0, 0]), float(rng.uniform(0.15, 0.3)))
    foot, top, back = (lean @ (np.array(k) * [thick, 0, long]) / 2 for k in ((1, 0, -1), (1, 0, 1), (-1, 0, -1)))
    scene.add(
        _box((thick, width, long)), (x - top[0], rng.uniform(width / 2 + 0.01, y - width / 2 - 0.01), -foot[2]), lean
    )
    _clutter(scene, (0, 0), (x - top[0] + back[0] - 0.005, y), 0.0, True)
    return scene.task("crate", seed, True, [], "fixed" if rng.random() < 0.5 else "any")


def _walls(scene: Scene, x: float, y: float, z: float, wall: float = 0.01) -> None:
    """A floor and four walls around it."""
    scene.fix((x + 2 * wall, y + 2 * wall, wall), (-wall, -wall, -wall))
    for side in (-wall, x):
        scene.fix((wall, y + 2 * wall, z), (side, -wall, 0))
    for side in (-wall, y):
        scene.fix((x, wall, z), (0, side, 0))


def _clutter(scene: Scene, low: Sequence[float], high: Sequence[float], z: float, walled: bool) -> None:
    """The object at a random place, then as many others beside it as find room within 60 tries each."""
    rng, there = scene.rng, list[shapely.Geometry]()
    room = shapely.box(*low, *high)
    for number in range(40):
        for _ in range(60):
            shape, yaw = _random_shape(rng), float(rng.uniform(0, 2 * np.pi))
            corners = shape.polyhedron.vertices @ rotation_about(Z, yaw).T
            middle = (corners.min(axis=0) + corners.max(axis=0))[:2] / 2
            at = rng.uniform(low, high)
            print_ = shapely.convex_hull(shapely.multipoints(corners[:, :2] - middle + at))
            clear = 0.004 if number else 0.0
            if not room.buffer(-clear if walled else 0.0).contains(print_) or any(
                o.distance(print_) < clear for o in there
            ):
                continue
            scene.stand(shape, *at, z, yaw, "" if number else "item")
            there.append(print_)
            break
        else:
            return


def table(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """A table full of things; only where the object stood is there room for it on the table itself."""
    scene = Scene(rng)
    x, y = rng.uniform(0.3, 0.6, 2)
    scene.fix((x, y, 0.02), (0, 0, 0.7))
    if possible:
        _clutter(scene, (0, 0), (x, y), 0.72, False)
        return scene.task("table", seed, True, [], "fixed")
    side = float(rng.uniform(0.05, 0.09))
    nx, ny = int(x / (1.5 * side)), int(y / (1.5 * side))
    for k in range(nx * ny):
        place = (np.array(divmod(k, ny)) + 0.5) * [x / nx, y / ny]
        scene.stand(_box((x / nx - side * 0.3, y / ny - side * 0.3, 0.15)), *place, 0.72)
    for k, (wide, deep) in enumerate(((x, 0.01), (x, 0.01), (0.01, y), (0.01, y))):
        scene.fix((wide, deep, 0.2), ((0, 0, -0.01, x)[k], (-0.01, y, 0, 0)[k], 0.7))
    scene.stand(_box(rng.uniform(0.6, 0.9, 3) * side), _FAR, 0, 0, name="item")
    return scene.task("table", seed, False, [_below(0.9)], "fixed")


def tote(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Random objects dropped into a tote in MuJoCo; the last one is taken out."""
    scene = Scene(rng)
    x, y, z = rng.uniform([0.25, 0.2, 0.15], [0.4, 0.3, 0.25])
    _walls(scene, x, y, z)
    count = int(rng.integers(4, 10))
    for k in range(count):
        turn, shape = _random_rotation(rng), _random_shape(rng)
        reach = float(np.linalg.norm(shape.polyhedron.vertices, axis=1).max())
        at = [*rng.uniform([reach, reach], np.maximum([x - reach, y - reach], reach + 1e-3)), 0.1 + 0.16 * k]
        scene.add(shape, at, turn, "item" if k == count - 1 else "")
    return _settled(scene.task("tote", seed), seconds=4.0)


def _random_rotation(rng: np.random.Generator) -> Array:
    q, r = np.linalg.qr(rng.normal(size=(3, 3)))
    q = q * np.sign(np.diag(r))
    return np.asarray(q if np.linalg.det(q) > 0 else -q)


def pallet(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Cartons in layers on slats, overhanging; one of the top layer, or of the second, is missing."""
    scene = Scene(rng)
    nx, ny, layers = int(rng.integers(2, 4)), int(rng.integers(2, 4)), int(rng.integers(1, 4))
    size, gap = rng.uniform([0.15, 0.12, 0.1], [0.3, 0.25, 0.2]), float(rng.uniform(0.003, 0.008))
    over = float(rng.uniform(0.0, 0.05))
    span = np.array([nx, ny]) * (size[:2] + gap) - gap
    slats = int(rng.integers(4, 8))
    for k in range(slats):
        room = (span[0] - 2 * over) / slats
        scene.fix((0.7 * room, span[1] - 2 * over, 0.02), (over + (k + 0.15) * room, over, 0.12))
    free = int(rng.integers(nx * ny))
    for layer in range(layers):
        for k in range(nx * ny):
            at = (np.array(divmod(k, ny)) + 0.5) * (size[:2] + gap) - gap / 2 + rng.normal(size=2) * 2e-4
            last = layer == layers - 1
            scene.stand(_box(size), *at, 0.14 + layer * size[2], name="item" if last and k == free else "")
    height = 0.14 + layers * size[2] + 0.005
    return scene.task("pallet", seed, True, [_below(height)])


def cupboard(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """Mugs, glasses and stacks of bowls under a board; a mug or the top bowl of a stack is missing."""
    scene, x0, deep = Scene(rng), 0.0, 0.12
    height, count = float(rng.uniform(0.14, 0.2)), int(rng.integers(3, 6))
    free, gap = int(rng.integers(count)), float(rng.uniform(0.004, 0.01))
    for k in range(count):
        kind, name = int(rng.integers(3)), "item" if k == free else ""
        shape = _cup(rng, 0.5 if kind == 2 else 0.0) if kind else Cylinder(float(rng.uniform(0.03, 0.04)), 0.12)
        low, high = (f(shape.polyhedron.vertices, axis=0) for f in (np.min, np.max))
        wide = float(high[0] - low[0])
        scene.stand(shape, x0 + gap + wide / 2, deep / 2, 0, name=name)
        x0 += wide + gap
    for z in (-0.015, height):
        scene.fix((x0 + gap, deep, 0.015), (0, 0, z))
    for x in (-0.015, x0 + gap):
        scene.fix((0.015, deep, height + 0.03), (x, 0, -0.015))
    scene.fix((x0 + gap + 0.03, 0.015, height + 0.03), (-0.015, deep, -0.015))
    return scene.task("cupboard", seed, True, [_upright("z"), _below(height)])


def tray(rng: np.random.Generator, seed: int, possible: bool) -> Task:
    """A tray with a lip on a counter, with clutter; the object may lie anywhere on the tray."""
    scene = Scene(rng)
    x, y = rng.uniform(0.2, 0.4, 2)
    _walls(scene, x, y, 0.02, 0.006)
    _clutter(scene, (0, 0), (x, y), 0.0, True)
    return scene.task("tray", seed)


def _settled(task: Task, seconds: float = 2.0) -> Task:
    """The bodies where they come to rest in MuJoCo."""
    everything = Assembly((*task.assembly.objects, task.item), friction=task.assembly.friction)
    engine = Engine(everything, 1e-3, damping=2.0)
    engine.run(seconds)
    engine.calm(10.0)
    engine.run(1.0)
    there = [b if b.fixed else replace(b, pose=engine.pose(b.id)) for b in everything.objects]
    return replace(task, assembly=replace(task.assembly, objects=tuple(there[:-1])), item=there[-1])


KINDS: dict[str, Callable[[np.random.Generator, int, bool], Task]] = {
    "dish rack": dish_rack,
    "spice shelf": spice_shelf,
    "drawer": drawer,
    "crate": crate,
    "table": table,
    "tote": tote,
    "pallet": pallet,
    "cupboard": cupboard,
    "tray": tray,
}
IMPOSSIBLE = ("spice shelf", "drawer", "table")
"""Kinds that there are without a place, too."""
