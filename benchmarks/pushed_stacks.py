"""Random pushes of random stacks: the answer against MuJoCo at 0.9 and 1.1 of it, and why the two disagree.

`python benchmarks/pushed_stacks.py [--scenes 60] [--first 0]`: towers of boxes, cylinders, hexagonal prisms and frusta,
bridges, and rows that touch side by side. Contacts of MuJoCo are stiff: 4 ms, elliptic cones, `impratio` 100. Where it
disagrees, the push is repeated with one property of the engine changed at a time, and the property is measured:

- `sinks`: soft contacts sink under the push. It holds with contacts 16 times as stiff, or stiffer.
- `points`: a face rests on few points. With such contacts and bodies cut into pieces it holds, and moves
  at 1.1 times what the most favourable contact forces hold.
- `pressure`: normal forces on few points, far from their centre, turn less easily than the even pressure of `patch`, or
  contact forces have a choice (`upper`). It moves at 1.1 times what the most favourable contact forces hold.
- `creep`: below 5 mm/s, it slides at 1.1 ten times as fast as at 0.9, where it rests.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from poise.assembly import Analysis, Assembly, Box, Cylinder, Mesh, Push, RigidObject, assess
from poise.assembly.robustness import Robustness
from poise.baselines.placement import Engine
from poise.geometry import Pose, rotation_about
from poise.types import Array

KINDS = ("tower", "tower", "bridge", "row")
_UP = np.array([0.0, 0.0, 1.0])
_STEP, _SETTLE, _RAMP, _HOLD = 1e-3, 0.25, 0.5, 1.0
_STIFF, _STIFFER, _STIFFEST, _DEEP = 4e-3, 1e-3, 4e-4, 1e-4
"""Time constants of contacts, s: at first, then, and for pushes under which those sink by more than that, m."""
_RESTS, _MOVES, _FELL = 2e-3, 5e-3, 2e-2
"""m in all, or m/s at the end: less is rest, more is motion; after so many m a run ends."""
_CREEPS, _TIMES = 2e-5, 10.0
"""m/s of creep at least, and how many times that at rest."""
_MOST = 500.0
"""N: larger answers are not tried."""
_SIDES = 3
"""Pieces along each side of a box."""


@dataclass(frozen=True)
class Run:
    """What a push did: m that a corner moved in all, m/s in the second half of the hold, m that contacts sank."""

    moved: float
    speed: float
    depth: float

    @property
    def rests(self) -> bool:
        return self.moved < _RESTS and self.speed < _RESTS

    @property
    def moves(self) -> bool:
        return self.moved > _MOVES or self.speed > _MOVES


def random_scene(seed: int) -> tuple[str, Analysis, np.random.Generator]:
    """A stack that stands with room, and the generator for its pushes."""
    rng = np.random.default_rng([seed, 4242])
    kind = KINDS[seed % len(KINDS)]
    floor = RigidObject("floor", Box((6.0, 6.0, 0.1)), _at(0, 0, -0.05), fixed=True)
    while True:
        bodies = {"tower": _tower, "bridge": _bridge, "row": _row}[kind](rng)
        analysis = Analysis.of(Assembly((floor, *bodies), friction=round(float(rng.uniform(0.25, 0.8)), 2)))
        found = analysis.stability()
        if found.margin > 0.02 and not found.doubtful:
            return kind, analysis, rng


def _at(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    return Pose(rotation_about(_UP, yaw), np.array([x, y, z], dtype=float))


def _body(rng: np.random.Generator) -> tuple[Box | Cylinder | Mesh, float, float]:
    """A shape, its mass, kg, and its height, m."""
    kind = rng.choice(["box", "box", "box", "cylinder", "prism", "frustum"])
    shape: Box | Cylinder | Mesh
    if kind == "box":
        x, y, z = rng.uniform(0.06, 0.2, 3).tolist()
        shape = Box((x, y, z))
    elif kind == "cylinder":
        shape = Cylinder(float(rng.uniform(0.04, 0.09)), float(rng.uniform(0.05, 0.16)))
    elif kind == "prism":
        angles = np.arange(6) * np.pi / 3
        shape = _prism(
            rng.uniform(0.05, 0.1) * np.column_stack([np.cos(angles), np.sin(angles)]), rng.uniform(0.05, 0.15)
        )
    else:
        sides = rng.uniform(0.09, 0.18, 2)
        corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1)]) * sides / 2
        shape = _prism(corners, rng.uniform(0.05, 0.12), rng.uniform(0.5, 0.95))
    density = float(np.exp(rng.uniform(np.log(200), np.log(2000))))
    return shape, density * shape.volume, float(np.ptp(shape.polyhedron.vertices[:, 2]))


def _prism(base: Array, height: float, top: float = 1.0) -> Mesh:
    """A prism over a convex polygon (N, 2), counter-clockwise, whose top is scaled."""
    n = len(base)
    rings = [np.column_stack([scale * base, np.full(n, z)]) for scale, z in ((1.0, -height / 2), (top, height / 2))]
    faces = [face for k in range(1, n - 1) for face in ((0, k + 1, k), (n, n + k, n + k + 1))]
    faces += [face for k in range(n) for face in ((k, (k + 1) % n, n + (k + 1) % n), (k, n + (k + 1) % n, n + k))]
    return Mesh(np.concatenate(rings), np.array(faces))


def _tower(rng: np.random.Generator) -> list[RigidObject]:
    made, height, centre = [], 0.0, np.zeros(2)
    for k in range(int(rng.integers(1, 6))):
        shape, mass, tall = _body(rng)
        centre = centre + rng.uniform(-0.03, 0.03, 2)
        place = _at(centre[0], centre[1], height + tall / 2, rng.uniform(0, 2 * np.pi))
        made.append(RigidObject(f"b{k}", shape, place, mass=mass))
        height += tall
    return made


def _bridge(rng: np.random.Generator) -> list[RigidObject]:
    tall, made = float(rng.uniform(0.08, 0.16)), []
    for k, side in enumerate((-1, 1)):
        shape = Box((float(rng.uniform(0.05, 0.12)), float(rng.uniform(0.08, 0.15)), tall))
        turn = rng.uniform(-0.3, 0.3)
        place = _at(side * rng.uniform(0.1, 0.16), rng.uniform(-0.02, 0.02), tall / 2, turn)
        made.append(RigidObject(f"leg{k}", shape, place, mass=float(rng.uniform(0.3, 2))))
    thick = float(rng.uniform(0.03, 0.08))
    place = _at(0, 0, tall + thick / 2, rng.uniform(-0.1, 0.1))
    made.append(RigidObject("slab", Box((0.44, 0.14, thick)), place, mass=float(rng.uniform(0.3, 3))))
    if rng.random() < 0.6:
        top, mass, high = _body(rng)
        place = _at(rng.uniform(-0.1, 0.1), 0, tall + thick + high / 2, rng.uniform(0, 6))
        made.append(RigidObject("top", top, place, mass=mass))
    return made


def _row(rng: np.random.Generator) -> list[RigidObject]:
    """Boxes that touch side by side, with others across."""
    count = int(rng.integers(2, 4))
    x, y, z = rng.uniform([0.08, 0.08, 0.06], 0.16).tolist()
    places = [(f"r{k}", k * x, z / 2) for k in range(count)]
    places += [(f"u{k}", (k + 0.5) * x, 1.5 * z) for k in range(count - 1) if rng.random() < 0.7]
    return [RigidObject(n, Box((x, y, z)), _at(a, 0, b), mass=float(rng.uniform(0.3, 2))) for n, a, b in places]


def random_push(analysis: Analysis, rng: np.random.Generator) -> Push:
    """At a random place of a random body, not from below, inwards and up to a steep angle."""
    items = [item for item in analysis.assembly.objects if not item.fixed]
    item = items[int(rng.integers(len(items)))]
    corners = item.vertices[item.shape.polyhedron.triangles]
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = np.linalg.norm(normals, axis=1)
    while True:
        number = int(rng.choice(len(areas), p=areas / areas.sum()))
        point, normal = rng.dirichlet([1, 1, 1]) @ corners[number], normals[number] / areas[number]
        way = rng.normal(0, 0.4, 3) - normal
        if normal[2] >= -0.5 and way @ normal < 0:
            return Push(item.id, point, way / np.linalg.norm(way))


class _InPieces(Engine):
    """Bodies cut into columns or wedges, so that a face has many contact points."""

    def _add_shape(self, spec: Any, body: Any, item: RigidObject, friction: float) -> None:
        if item.fixed:
            super()._add_shape(spec, body, item, friction)
            return
        common = {"friction": [friction, 0.0, 0.0], "condim": 3, "solref": [_STIFF, 1.0]}
        for number, corners in enumerate(_pieces(item)):
            spec.add_mesh(name=f"{item.id}/{number}", uservert=corners.ravel())
            body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=f"{item.id}/{number}", **common)


def _pieces(item: RigidObject) -> Iterator[Array]:
    """(K, 3) corners of convex pieces of a box, or of a solid with one ring of corners below and one above."""
    corners = item.shape.polyhedron.vertices
    low, high = corners.min(axis=0), corners.max(axis=0)
    if isinstance(item.shape, Box):
        size = (high - low) * [1 / _SIDES, 1 / _SIDES, 1]
        unit = (corners - low) / (high - low)
        yield from (low + size * (unit + np.array([i, j, 0])) for i in range(_SIDES) for j in range(_SIDES))
        return
    rings = [corners[np.isclose(corners[:, 2], z)] for z in (low[2], high[2])]
    rings = [ring[np.argsort(np.arctan2(ring[:, 1], ring[:, 0]))] for ring in rings]
    wide = max(1, len(rings[0]) // 10)
    for k in range(0, len(rings[0]), wide):
        some = [(k + j) % len(rings[0]) for j in range(wide + 1)]
        yield np.vstack([part for ring in rings for part in (ring.mean(axis=0)[None], ring[some])])


def pushed(engine: Engine, push: Push, force: float, stiff: float = _STIFF) -> Run:
    """What a force, N, at a point of a body does that grows and then stays."""
    engine.restart()
    engine.step = engine.model.opt.timestep = min(_STEP, stiff / 4)
    engine.model.geom_solref[:, 0] = stiff
    engine.run(_SETTLE)
    begin, middle, depth = engine.poses, engine.poses, 0.0
    number = engine.model.body(push.object).id
    local, way = engine.pose(push.object).undo(np.asarray(push.point)), np.asarray(push.direction)
    steps = round((_RAMP + _HOLD) / engine.step)
    for k in range(steps):
        now = min(1.0, (k + 1) * engine.step / _RAMP) * force * way
        arm = engine.pose(push.object).apply(local) - engine.data.xipos[number]
        engine.data.xfrc_applied[number] = np.concatenate([now, np.cross(arm, now)])
        engine.run(engine.step)
        depth = max([depth, *(-engine.data.contact.dist).tolist()])
        if k == round((_RAMP + _HOLD / 2) / engine.step):
            middle = engine.poses
        if k % 50 == 0 and (moved := engine.moved(begin)) > _FELL:
            return Run(moved, np.inf, depth)
    return Run(engine.moved(begin), engine.moved(middle) / (_HOLD / 2), depth)


def explained(analysis: Analysis, push: Push, found: Robustness, runs: tuple[Run, Run]) -> tuple[str, str]:
    """Which property of the engine a disagreement is due to, and its measure; "open" if none."""
    assembly, force = analysis.assembly, found.robustness
    favourable = assess(analysis, [push], model="limit").results[0].robustness
    most = max(found.upper, favourable)
    if not runs[0].rests:
        mass = assembly.objects[assembly.index[push.object]].mass
        stiff = float(np.clip(np.sqrt(_DEEP * mass / force), _STIFFEST, _STIFFER))
        again = pushed(Engine(assembly, _STEP), push, 0.9 * force, stiff)
        if again.rests:
            return "sinks", f"{1e3 * runs[0].depth:.2f} mm deep, then {1e3 * again.depth:.2f} mm and at rest"
        engine = _InPieces(assembly, _STEP)
        again = pushed(engine, push, 0.9 * force, stiff)
        if again.rests and pushed(engine, push, 1.1 * most, stiff).moves:  # no piece catches on another
            return "points", f"in pieces {1e3 * again.moved:.2f} mm"
        return "open", f"moves {1e3 * runs[0].moved:.1f} mm at 0.9"
    if most > 1.01 * force and pushed(Engine(assembly, _STEP), push, 1.1 * most).moves:
        return "pressure", f"moves at 1.1 of {most / force:.2f} times the answer"
    if runs[1].speed > _CREEPS and runs[1].speed > _TIMES * runs[0].speed:
        return "creep", f"{1e3 * runs[1].speed:.2f} mm/s at 1.1, {1e3 * runs[0].speed:.3f} at 0.9"
    return "open", f"{1e3 * runs[1].moved:.2f} mm at 1.1"


def compared(seed: int, pushes: int = 2) -> Iterator[tuple[str, str]]:
    """For each push of a scene what came of it, and a line about it."""
    kind, analysis, rng = random_scene(seed)
    for number in range(pushes):
        push = random_push(analysis, rng)
        found = assess(analysis, [push]).results[0]
        force, about = found.robustness, f"{seed} {kind} {number} {push.object}"
        if not np.isfinite(force) or force > _MOST:
            continue
        engine = Engine(analysis.assembly, _STEP)
        runs = pushed(engine, push, 0.9 * force), pushed(engine, push, 1.1 * force)
        outcome, why = ("agrees", "") if runs[0].rests and runs[1].moves else explained(analysis, push, found, runs)
        yield outcome, f"{about}: {found.mode} at {force:.3f} N: {outcome} {why}"


def main() -> None:
    """Compare, and print a line about each disagreement and the counts."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--first", type=int, default=0, help="seed of the first scene")
    parser.add_argument("--quick", action="store_true", help="four scenes")
    given = parser.parse_args()
    counts: Counter[str] = Counter()
    for seed in range(given.first, given.first + (4 if given.quick else given.scenes)):
        for outcome, line in compared(seed):
            counts[outcome] += 1
            if outcome != "agrees":
                print(line, flush=True)
    total = sum(counts.values())
    print(f"| {total} pushes | " + " | ".join(f"{name} {count}" for name, count in counts.most_common()) + " |")


if __name__ == "__main__":
    main()
