"""Limits and maps that symmetries of scenes carry on, against those asked one by one.

Walls, pyramids, crossed layers, shelves and tables, as they are, turned and on an incline, and random scenes of
`benchmarks.touching`. `python -m benchmarks.mirrored --scenes 4 --seed 77`
"""

import argparse
import time
from collections.abc import Iterator
from dataclasses import replace
from unittest.mock import patch

import numpy as np

from benchmarks import growth, touching
from poise.assembly import Analysis, Assembly, acceleration_limits, robustness_map
from poise.assembly.robustness.acceleration import AccelerationLimits
from poise.assembly.robustness.maps import RobustnessMap
from poise.assembly.statics.block_solvers import BlockSolvers
from poise.geometry import Pose

_DIRECTIONS, _POINTS = 36, 400
_AZIMUTH, _INCLINE = 1.1, 0.1


def pyramid(layers: int) -> Assembly:
    """Bricks in running bond, one less in each layer."""
    places = [(i - (layers - k - 1) / 2, k) for k in range(layers) for i in range(layers - k)]
    boxes = [growth.box(f"b{n}", (0.2, 0.1, 0.1), (0.2 * x, 0.0, 0.05 + 0.1 * k)) for n, (x, k) in enumerate(places)]
    return growth.on_floor(boxes)


def crossed(layers: int) -> Assembly:
    """Two beams in each layer, across those below."""
    boxes = []
    for k in range(layers):
        for side in (-0.1, 0.1):
            size, place = ((0.3, 0.1), (0.0, side)) if k % 2 else ((0.1, 0.3), (side, 0.0))
            boxes.append(growth.box(f"x{len(boxes)}", (*size, 0.1), (*place, 0.05 + 0.1 * k)))
    return growth.on_floor(boxes)


def turned(assembly: Assembly, angle: float) -> Assembly:
    """The same scene after a turn about the vertical, rad."""
    c, s = np.cos(angle), np.sin(angle)
    turn = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    poses = [Pose(turn @ item.pose.rotation, turn @ item.pose.translation) for item in assembly.objects]
    items = (replace(item, pose=pose) for item, pose in zip(assembly.objects, poses, strict=True))
    return replace(assembly, objects=tuple(items))


def inclined(assembly: Assembly, angle: float) -> Assembly:
    """The same scene on an incline along x, rad."""
    return replace(assembly, gravity=9.81 * np.array([np.sin(angle), 0.0, -np.cos(angle)]))


def scenes(count: int, seed: int) -> Iterator[tuple[str, Assembly]]:
    """The scenes, by name; of random ones `count` of each kind."""
    whole = {"wall": growth.wall(10), "wall of 12": growth.wall(12), "pyramid": pyramid(4), "crossed": crossed(5)}
    whole |= {"tables": growth.tables(6), "shelf": growth.shelf(18), "pallet": growth.pallet(24)}
    yield from whole.items()
    yield from ((f"{name}, turned", turned(whole[name], _AZIMUTH)) for name in ("wall", "crossed"))
    yield "pyramid, inclined", inclined(whole["pyramid"], _INCLINE)
    rng = np.random.default_rng(seed)
    yield from ((kind, touching.random_scene(kind, rng)) for _ in range(count) for kind in touching.KINDS)


def answers(assembly: Assembly) -> tuple[AccelerationLimits, RobustnessMap, float]:
    """Limits, a map, and CPU s."""
    analysis = Analysis.of(assembly)
    analysis.stability()
    begin = time.process_time()
    found = acceleration_limits(analysis, _DIRECTIONS, turning=False), robustness_map(analysis, _POINTS)
    return *found, time.process_time() - begin


def row(name: str, assembly: Assembly) -> str:
    """One line of the table: lower bounds of each of both maps are compared with the upper ones of the other."""
    analysis = Analysis.of(assembly)
    if not analysis.stability().stable:
        return f"| {name} | does not stand |"
    symmetries = max(len(block.solvers.symmetries) for block in analysis.blocks)
    limits, found, seconds = answers(assembly)
    with patch.object(BlockSolvers, "symmetries", ()):
        each_limits, each, each_seconds = answers(assembly)
    ratio = limits.limits / each_limits.limits
    with np.errstate(invalid="ignore"):
        crossing = [float(np.nanmax(a.lower / b.upper)) for a, b in ((found, each), (each, found))]
    cells = [
        str(symmetries),
        f"{np.nanmin(ratio):.4f} to {np.nanmax(ratio):.4f}",
        f"{crossing[0]:.3f}; {crossing[1]:.3f}",
        f"{found.doubtful.mean():.2f}; {each.doubtful.mean():.2f}",
        f"{seconds:.2f}; {each_seconds:.2f}",
    ]
    return f"| {name} | {' | '.join(cells)} |"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=4, help="of each random kind")
    parser.add_argument("--seed", type=int, default=77)
    given = parser.parse_args()
    print("| scene | symmetries | limits, ratio | maps, lower over upper bounds | doubtful | CPU s, with; without |")
    print("| --- | --- | --- | --- | --- | --- |")
    for name, assembly in scenes(given.scenes, given.seed):
        print(row(name, assembly), flush=True)


if __name__ == "__main__":
    main()
