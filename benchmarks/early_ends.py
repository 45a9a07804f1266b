"""Pushes and limits that are given as exact: do elastic contacts stand at more?

Random walls, pallets and rows of touching boxes. Of each answer that is not marked doubtful, another solver (rounds of
Tresca problems, from contacts that do not slip) is asked whether the block stands at 1.03 times as much, where limit
analysis allows that. `python -m benchmarks.early_ends --scenes 10 --seed 1`
"""

import argparse
import time
from dataclasses import dataclass

import numpy as np

from benchmarks import level_limits, touching
from benchmarks.growth import random_pushes
from poise.assembly import Analysis, Assembly, assess
from poise.assembly.robustness.elastic_limits import ElasticLimits, inertial_loads
from poise.assembly.statics import NO_DEADLINE, BlockAnalysis, loads_of
from poise.types import Array

KINDS = ("row", "small wall", "small pallet", "wall", "pallet")
MORE = 1.03
_PUSHES, _DIRECTIONS, _FASTEST = 20, 24, 1000.0


def random_scene(kind: str, rng: np.random.Generator) -> Assembly:
    """Up to twelve boxes of `benchmarks.touching`, or 21 to 40 of `benchmarks.level_limits`."""
    if kind in level_limits.KINDS:
        return level_limits.random_scene(kind, rng)
    return touching.random_scene(kind.removeprefix("small "), rng)


@dataclass
class EarlyTally:
    """Answers whose contact forces have a choice: those marked, those at more than which the block stands, CPU in s."""

    answers: int = 0
    marked: int = 0
    low: int = 0
    seconds: float = 0.0

    def row(self, kind: str) -> str:
        return f"| {kind} | {self.answers} | {self.marked} | {self.low} | {self.seconds:.1f} |"

    def add(self, block: BlockAnalysis, load: Array, value: float, marked: bool) -> None:
        """Count one answer: a block holds a load (6 n,) times a value."""
        if not 0 < value < np.inf:
            return
        self.answers += 1
        self.marked += marked
        allowed = block.solvers.limit.inverse_factor(load).upper * MORE * value < 1
        if allowed and not marked:
            gravity = block.geometry.gravity.ravel()
            self.low += block.solvers.coulomb.settle(gravity + MORE * value * load).stands


def ask(assembly: Assembly, rng: np.random.Generator, tally: EarlyTally) -> None:
    """Add the answers about one scene to a tally."""
    analysis = Analysis.of(assembly)
    blocks = [block for block in analysis.blocks if not block.geometry.statically_determinate]
    if not analysis.stability().stable or len(analysis.blocks) != 1 or not blocks:
        return
    block = blocks[0]
    pushes, directions = random_pushes(analysis, _PUSHES, rng), level_limits.around(_DIRECTIONS)
    begin = time.process_time()
    found = assess(analysis, pushes, "coulomb").results
    most = np.full(_DIRECTIONS, _FASTEST)
    limits = ElasticLimits(block, inertial_loads(block), directions, most, NO_DEADLINE, patches=False).solve()
    tally.seconds += time.process_time() - begin
    questions, loads = block.loads(loads_of(analysis.assembly, pushes, analysis.structure.margin))
    for question, load in zip(questions.tolist(), loads, strict=True):
        tally.add(block, load, found[question].lower, found[question].doubtful)
    loads = (inertial_loads(block) @ directions.T).T
    for load, value, marked in zip(loads, limits.limits.tolist(), (~limits.known).tolist(), strict=True):
        tally.add(block, load, value, marked)


def main() -> None:
    """Print the table of docs/robustness_results.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=10, help="of each kind")
    parser.add_argument("--seed", type=int, default=1)
    given = parser.parse_args()
    print("| scenes | answers | marked | stands at more | CPU s |\n| --- | --- | --- | --- | --- |")
    for number, kind in enumerate(KINDS):
        rng, tally = np.random.default_rng([given.seed, number]), EarlyTally()
        for _ in range(given.scenes):
            ask(random_scene(kind, rng), rng, tally)
        print(tally.row(kind), flush=True)


if __name__ == "__main__":
    main()
