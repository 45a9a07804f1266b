"""Where acceleration limits end in MuJoCo: single bodies with a closed form, then random stacks of boxes.

`python -m benchmarks.carrying_edge [--scenes 6] [--first 800]`: the base accelerates for a second, at shares of limits.
"""

import argparse

import numpy as np

from benchmarks.scanned_stacks import MOVED, moves
from benchmarks.touching import KINDS, random_scene
from poise.assembly import Analysis, Assembly, Box, Cylinder, RigidObject, acceleration_limits
from poise.assembly.scene import Shape
from poise.geometry import Pose

SHARES = (0.8, 0.9, 0.95, 0.98, 1.0, 1.02, 1.1, 1.5)
BODIES: dict[str, tuple[Shape, float, float, float]] = {
    "a box slides": (Box((0.1, 0.1, 0.06)), 0.05, 0.03, 0.4),
    "a box tips": (Box((0.05, 0.05, 0.12)), 0.025, 0.06, 0.8),
    "a can slides": (Cylinder(0.03, 0.06), 0.03, 0.03, 0.4),
    "a can tips": (Cylinder(0.03, 0.12), 0.03, 0.06, 0.8),
}
"""A shape, m from its middle to the edge over which it tips, m of its centre of mass over the tray, and friction."""
GRAVITY = 9.81


def on_tray(shape: Shape, height: float, friction: float) -> Assembly:
    """One body on a flat tray."""
    places = (Pose(np.eye(3), np.array([0.0, 0.0, z])) for z in (-0.05, height))
    tray = RigidObject("tray", Box((2.0, 2.0, 0.1)), next(places), fixed=True)
    return Assembly((tray, RigidObject("body", shape, next(places), mass=0.5)), np.array([0, 0, -GRAVITY]), friction)


def at_shares(stack: Assembly, count: int) -> tuple[list[float], dict[float, list[float]]]:
    """Limits, m/s2, in `count` horizontal directions; and for each share, m that each object moves in each of them."""
    angles = 2 * np.pi * np.arange(count) / count
    ways = np.column_stack([np.cos(angles), np.sin(angles), 0 * angles])
    limits = acceleration_limits(Analysis.of(stack), ways, 60.0, turning=False).limits
    pairs = list(zip(limits, ways, strict=True))
    return limits.tolist(), {s: [m for a, way in pairs for m in moves(stack, s * a * way)] for s in SHARES}


def main() -> None:
    """Print the tables of docs/carry.md."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=6)
    parser.add_argument("--first", type=int, default=800, help="first seed")
    parser.add_argument("--quick", action="store_true", help="one random stack")
    given = parser.parse_args()
    print("share", *SHARES, sep=" | ")
    for name, (shape, edge, height, friction) in BODIES.items():
        (limit,), found = at_shares(on_tray(shape, height, friction), 1)
        exact = GRAVITY * min(friction, edge / height)
        print(f"{name}, limit {limit:.4f}, exact {exact:.4f} m/s2: mm", *(f"{1e3 * m:.2f}" for (m,) in found.values()))
    for seed in range(given.first, given.first + (1 if given.quick else given.scenes)):
        stack = random_scene(KINDS[seed % len(KINDS)], np.random.default_rng(seed))
        found = at_shares(stack, 4)[1].values()
        counts = [f"{sum(not m <= MOVED for m in moved)} of {len(moved)}" for moved in found]  # NaN: fell before
        print(seed, *counts, sep=" | ", flush=True)


if __name__ == "__main__":
    main()
