"""Acceleration limits in many level directions: those that begin beside others, against each followed from rest.

Random walls and pallets of 21 to 40 touching boxes. Also counted: whether elastic contacts stand at 0.98 of what
convexity says between two limits that were followed from rest, 20 degrees apart; and what holds in MuJoCo at 0.9 of the
limit, in random directions and in those with the largest ratios. `python -m benchmarks.level_limits --scenes 10`
"""

import argparse
import time
from dataclasses import dataclass, field

import numpy as np

from benchmarks.touching import holds_in_mujoco
from poise.assembly import Analysis, Assembly, Box, RigidObject, acceleration_limits
from poise.assembly.robustness.elastic_limits import ElasticLimits, inertial_loads
from poise.assembly.robustness.plane_curve import PlaneCurve
from poise.assembly.statics import NO_DEADLINE, BlockAnalysis
from poise.geometry import Pose
from poise.types import Array

KINDS = ("wall", "pallet")
DIRECTIONS = 72
_FASTEST, _APART, _HELD, _SHARE = 1000.0, 4, 0.9, 0.98


def random_scene(kind: str, rng: np.random.Generator) -> Assembly:
    """A wall that narrows upwards, or layers of cartons that are turned in turn; random sizes, masses and friction."""
    x, y, z = rng.uniform([0.15, 0.08, 0.06], [0.3, 0.15, 0.2])
    count = int(rng.integers(21, 41))
    boxes: list[tuple[Array, Array]] = []
    layer = 0
    while len(boxes) < count:
        if kind == "wall":
            along = np.arange(9 - layer) - (8 - layer) / 2
            boxes += [(np.array([x, y, z]), np.array([i * x, 0, (layer + 0.5) * z])) for i in along]
        else:
            size = np.array([0.3, 0.2, z] if layer % 2 == 0 else [0.2, 0.3, z])
            nx, ny = round(0.6 / size[0]), round(0.6 / size[1])
            places = [((i + 0.5) * size[0] - 0.3, (j + 0.5) * size[1] - 0.3) for i in range(nx) for j in range(ny)]
            boxes += [(size, np.array([*place, (layer + 0.5) * z])) for place in places]
        layer += 1
    floor = RigidObject("floor", Box((9.0, 9.0, 0.1)), Pose(np.eye(3), np.array([0, 0, -0.05])), fixed=True)
    made = [
        RigidObject(f"b{i}", Box(tuple(size)), Pose(np.eye(3), place), mass=float(rng.uniform(0.5, 2.0)))
        for i, (size, place) in enumerate(boxes[:count])
    ]
    return Assembly((floor, *made), np.array([0.0, 0.0, -9.81]), float(rng.uniform(0.3, 0.7)))


def around(count: int) -> Array:
    """(count, 3) level directions."""
    azimuth = 2 * np.pi * np.arange(count) / count
    return np.stack([np.cos(azimuth), np.sin(azimuth), np.zeros(count)], axis=1)


@dataclass
class LevelTally:
    """Ratios to limits followed from rest; chords asked and held; directions held in MuJoCo; processor times, s."""

    ratios: list[float] = field(default_factory=list)
    chords: list[bool] = field(default_factory=list)
    held: list[bool] = field(default_factory=list)
    seconds: tuple[float, float] = (0.0, 0.0)
    from_rest: int = 0

    def row(self, kind: str) -> str:
        ratios = np.array(self.ratios)
        cells = [
            f"{np.median(ratios):.3f} ({np.quantile(ratios, 0.05):.3f}, {ratios.min():.3f} to {ratios.max():.3f})",
            f"{np.sum(ratios > 1.05)} of {len(ratios)}",
            f"{sum(self.chords)} of {len(self.chords)}",
            f"{sum(self.held)} of {len(self.held)}",
            str(self.from_rest),
            f"{self.seconds[0]:.1f} / {self.seconds[1]:.1f}",
        ]
        return f"| {kind} | {' | '.join(cells)} |"


def one_by_one(block: BlockAnalysis, directions: Array) -> Array:
    """(D,) m/s2 of elastic contacts, each direction followed from rest."""
    loads = inertial_loads(block) @ directions.T
    return np.array([block.solvers.coulomb.factor(load, _FASTEST).value for load in loads.T])


def chords_hold(block: BlockAnalysis, directions: Array, limits: Array) -> list[bool]:
    """Whether elastic contacts stand halfway between limits at 0.98 of what convexity says."""
    loads, gravity = inertial_loads(block), block.geometry.gravity.ravel()
    curve, azimuths = PlaneCurve(), np.arctan2(directions[:, 1], directions[:, 0]) % (2 * np.pi)
    for k in range(0, len(limits), _APART):
        curve.add(float(azimuths[k]), float(limits[k]))
    held = []
    for k in range(_APART // 2, len(limits), _APART):
        chord = curve.chord(float(azimuths[k]))
        if chord is not None:
            load = gravity + _SHARE * chord.reach * loads @ directions[k]
            held.append(block.solvers.coulomb.settle(load).stands)
    return held


def compare(assembly: Assembly, rng: np.random.Generator, tally: LevelTally, asked: int = 2) -> None:
    """Add one scene to a tally."""
    analysis, directions = Analysis.of(assembly), around(DIRECTIONS)
    if not analysis.stability().stable:
        return
    highest: list[int] = []
    for block in analysis.blocks:
        if block.geometry.statically_determinate:
            continue
        most = np.full(DIRECTIONS, _FASTEST)
        begin = time.process_time()
        found = ElasticLimits(block, inertial_loads(block), directions, most, NO_DEADLINE, patches=False).solve()
        middle = time.process_time()
        single = one_by_one(block, directions)
        tally.seconds = (
            tally.seconds[0] + middle - begin,
            tally.seconds[1] + time.process_time() - middle,
        )
        tally.ratios += (found.limits / single).tolist()
        tally.chords += chords_hold(block, directions, single)
        tally.from_rest += found.from_rest
        highest = np.argsort(found.limits / single)[-asked:].tolist() if asked else []
    limits = acceleration_limits(analysis, DIRECTIONS, turning=False).limits
    for k in [*highest, *rng.choice(DIRECTIONS, asked, replace=False).tolist()]:
        tally.held.append(holds_in_mujoco(assembly, _HELD * limits[k] * directions[k]))


def main() -> None:
    """Print the table of docs/robustness_results.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    heads = ("ratio: median (5 %, least to largest)", "above 1.05", "chords held", "held in MuJoCo", "from rest")
    print(f"| scenes | {' | '.join((*heads, 'CPU s / one by one'))} |")
    print("| --- | --- | --- | --- | --- | --- | --- |")
    for number, kind in enumerate(KINDS):
        tally = LevelTally()
        for scene in range(given.scenes):
            rng = np.random.default_rng([given.seed, number, scene])
            compare(random_scene(kind, rng), rng, tally)
        print(tally.row(kind), flush=True)


if __name__ == "__main__":
    main()
