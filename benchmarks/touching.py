"""Objects that touch side by side: limits and maps against single pushes of the same forces, and against MuJoCo.

Random rows on a post, walls and pallets of boxes. `python benchmarks/touching.py --scenes 48`
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import dataclass, field

import numpy as np

from poise.assembly import Analysis, Assembly, Box, Push, RigidObject, acceleration_limits, assess, robustness_map
from poise.assembly.robustness import DEFAULT_MODEL, ROBUSTNESS_MODELS
from poise.assembly.statics import NO_DEADLINE, Loads
from poise.baselines.placement import Engine
from poise.geometry import Pose, wrench_of_force
from poise.types import Array

KINDS = ("row", "wall", "pallet")
ABOVE = 1.05
"""Ratios above this count as too high."""
_HELD_SHARE, _MOVED = 0.9, 0.01


def random_scene(kind: str, rng: np.random.Generator) -> Assembly:
    """A row of boxes on a post, a wall in running bond, or layers of cartons on a pallet; boxes touch."""
    length, depth, height = rng.uniform([0.1, 0.06, 0.05], [0.2, 0.12, 0.2])
    friction = float(rng.uniform(0.3, 0.7))
    boxes: list[tuple[float, float, float]] = []
    if kind == "row":
        count = int(rng.integers(2, 5))
        boxes = [((i - (count - 1) / 2) * length, 0.0, height / 2) for i in range(count)]
        width = (count - 1) * length + 2 * rng.uniform(0.002, 0.4 * length)
    elif kind == "wall":
        rows, count = 2, int(rng.integers(2, 4))
        for row in range(rows):
            places = np.arange(count - row % 2) - (count - row % 2 - 1) / 2
            boxes += [(float(x) * length, 0.0, (row + 0.5) * height) for x in places]
        width = count * length
    else:
        layers, nx, ny = int(rng.integers(1, 3)), 2, int(rng.integers(1, 3))
        for layer in range(layers):
            boxes += [
                ((i - 0.5) * length, (j - (ny - 1) / 2) * depth, (layer + 0.5) * height)
                for i in range(nx)
                for j in range(ny)
            ]
        width = nx * length - 2 * rng.uniform(0.0, 0.3 * length)
    post = RigidObject("post", Box((float(width), 2.0, 0.1)), _at(0, 0, -0.05), fixed=True)
    made = [
        RigidObject(f"b{i}", Box((length, depth, height)), _at(*place), mass=float(rng.uniform(0.5, 2.0)))
        for i, place in enumerate(boxes)
    ]
    return Assembly((post, *made), np.array([0.0, 0.0, -9.81]), friction)


def _at(x: float, y: float, z: float) -> Pose:
    return Pose(np.eye(3), np.array([x, y, z], dtype=float))


def single_limits(analysis: Analysis, directions: Array) -> Array:
    """(D,) m/s2 up to which single questions of the same inertial forces hold."""
    objects, movable = analysis.assembly.objects, analysis.structure.movable
    count = len(directions)
    masses = np.array([objects[place].mass for place in movable])
    com = np.array([objects[place].com_in_world for place in movable])
    forces = -masses[:, None] * directions[:, None, :]
    wrenches = np.concatenate([wrench_of_force(force, com) for force in forces])
    loads = Loads(np.repeat(np.arange(count), len(movable)), np.tile(movable, count), wrenches, count)
    found = ROBUSTNESS_MODELS.find(DEFAULT_MODEL).solve(analysis, loads, NO_DEADLINE)
    return np.where(found.lower < 0.97 * found.upper, found.lower, found.upper)


def single_pushes(analysis: Analysis, points: Array, directions: Array, places: Array) -> Array:
    """(N,) N that single pushes at these points may have."""
    objects = analysis.assembly.objects
    pushes = [Push(objects[p].id, x, d) for p, x, d in zip(places.tolist(), points, directions, strict=True)]
    return np.array([result.robustness for result in assess(analysis, pushes).results])


def followed(analysis: Analysis, point: Array, direction: Array, place: int, force: float) -> float:
    """N, at most `force`, up to which elastic contacts stand while a push grows in steps of 2 % of it or less.

    A single push asks for as few states as it can. Where friction allows several, it may miss those in which the block
    stands, and gives less; followed from rest, each state begins at the one before.
    """
    wrench = wrench_of_force(direction, point)[None]
    loads = Loads(np.zeros(1, dtype=np.int64), np.array([place]), wrench, 1)
    least = force
    for block in analysis.blocks:
        for load in block.loads(loads)[1]:
            coulomb, state, held, step = block.solvers.coulomb, block.solvers.coulomb.rest, 0.0, force / 50
            while held < force and step > force / 2000:
                now = min(held + step, force)
                there = coulomb.settle(block.geometry.gravity.ravel() + now * load, state.displacement)
                if there.stands:
                    state, held = there, now
                else:
                    step /= 2
            least = min(least, held)
    return least


def holds_in_mujoco(assembly: Assembly, acceleration: Array) -> bool:
    """Whether nothing moves by `_MOVED` m on a base that accelerates for a second, after it has settled."""
    engine = Engine(assembly, 1e-3)
    engine.run(0.25)
    before = engine.poses
    for share in np.linspace(0.1, 1.0, 10):
        engine.set_gravity(np.asarray(assembly.gravity) - share * acceleration)
        engine.run(0.05)
    engine.run(0.5)
    return engine.moved(before) < _MOVED


@dataclass
class Tally:
    """Ratios of limits and lower bounds to what single pushes give, those marked doubtful apart.

    Bounds above a single push are compared with that push `followed` from rest.
    """

    limits: list[float] = field(default_factory=list)
    bounds: list[float] = field(default_factory=list)
    doubtful: list[float] = field(default_factory=list)
    held: list[bool] = field(default_factory=list)
    followed: int = 0
    unstable: int = 0
    seconds: float = 0.0

    def row(self, kind: str) -> str:
        high = [sum(ratio > ABOVE for ratio in ratios) for ratios in (self.limits, self.bounds, self.doubtful)]
        worst = max([0.0, *self.limits]), max([0.0, *self.bounds]), max([0.0, *self.doubtful])
        counts = len(self.limits), len(self.bounds), len(self.doubtful)
        cells = [f"{n} of {m}, worst {w:.2f}" for n, m, w in zip(high, counts, worst, strict=True)]
        cells += [f"{sum(self.held)} of {len(self.held)}", str(self.followed), f"{self.seconds:.0f}"]
        return f"| {kind} | {' | '.join(cells)} |"


def compare(assembly: Assembly, rng: np.random.Generator, tally: Tally, points: int = 60, asked: int = 6) -> None:
    """Add one scene to a tally."""
    analysis = Analysis.of(assembly)
    if not analysis.stability().stable:
        tally.unstable += 1
        return
    start = time.process_time()
    directions = rng.normal(size=(4, 3)) * [1, 1, 0.2]
    limits = acceleration_limits(analysis, directions, turning=False)
    found = robustness_map(analysis, points, 0.05)
    tally.seconds += time.process_time() - start
    tally.limits += (limits.limits / single_limits(analysis, limits.directions)).tolist()
    rows = rng.choice(len(found.lower), min(asked, len(found.lower)), replace=False)
    surface = found.surface
    single = single_pushes(analysis, surface.points[rows], surface.directions[rows], surface.place[rows])
    for row, force in zip(rows.tolist(), single, strict=True):
        lower = float(found.lower[row])
        if not (np.isfinite(lower) and force > 0):
            continue
        if lower > ABOVE * force:
            push = surface.points[row], surface.directions[row], int(surface.place[row])
            tally.followed += 1
            force = max(force, followed(analysis, *push, lower))
        (tally.doubtful if found.doubtful[row] else tally.bounds).append(lower / force)
    weakest = int(limits.limits.argmin())
    tally.held.append(holds_in_mujoco(assembly, _HELD_SHARE * limits.limits[weakest] * limits.directions[weakest]))


def scenes(count: int, seed: int) -> Iterator[tuple[str, Assembly, np.random.Generator]]:
    """Scenes of all kinds in turn, each with its own generator."""
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        kind = KINDS[number % len(KINDS)]
        yield kind, random_scene(kind, rng), rng


def main() -> None:
    """Print the table of docs/robustness_results.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--quick", action="store_true", help="6 scenes")
    given = parser.parse_args()
    tallies = {kind: Tally() for kind in KINDS}
    for kind, assembly, rng in scenes(6 if given.quick else given.scenes, given.seed):
        compare(assembly, rng, tallies[kind])
    names = ("scenes", "limits too high", "map lower bounds too high", "doubtful ones too high", "held in MuJoCo")
    print(f"| {' | '.join((*names, 'pushes followed', 'CPU s'))} |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for kind, tally in tallies.items():
        print(tally.row(kind))


if __name__ == "__main__":
    main()
