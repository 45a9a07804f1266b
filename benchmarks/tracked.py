"""What a tracker costs: poses that come ten times a second with errors, each time settled, analysed and pushed once.

    python -m benchmarks.tracked --frames 40 --seed 11

Scenes of ten objects: cartons that touch on all sides, five stacks of two, and two boards of a shelf. Every frame is
the true scene with new errors of 2 mm and 0.5 degrees. Counted are processor time, and how often the pairs that touch
change from one frame to the next, with and without the contacts of the frame before (`settle(..., before)`).
"""

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from benchmarks.perceived import cartons, random_pushes, seen
from poise.assembly import Analysis, Assembly, Box, RigidObject, assess, assess_settled, settle
from poise.assembly.robustness import carried
from poise.assembly.statics import analysis_after
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about

_GRAVITY = np.array([0.0, 0.0, -9.81])


def _box(
    name: str, size: tuple[float, float, float], place: tuple[float, float, float], yaw: float = 0.0
) -> RigidObject:
    pose = Pose(rotation_about([0.0, 0.0, 1.0], yaw), np.array(place))
    return RigidObject(name, Box(size), pose, mass=500 * size[0] * size[1] * size[2])


def _floor(size: float = 9.0, height: float = 0.0, name: str = "floor") -> RigidObject:
    pose = Pose(np.eye(3), np.array([0.0, 0.0, height - 0.01]))
    return RigidObject(name, Box((size, size, 0.02)), pose, fixed=True)


def _pallet(_: np.random.Generator) -> list[RigidObject]:
    return cartons(5, 1, 2, (0.2, 0.15, 0.1), 1.0)


def _stacks(rng: np.random.Generator) -> list[RigidObject]:
    boxes = [_floor()]
    for k in range(5):
        low, top = rng.uniform(0.15, 0.3, 2), rng.uniform(0.1, 0.14, 2)
        yaw = rng.uniform(-3, 3, 2).tolist()
        boxes.append(_box(f"low{k}", (float(low[0]), float(low[1]), 0.1), (0.6 * k, 0.0, 0.05), yaw[0]))
        boxes.append(_box(f"top{k}", (float(top[0]), float(top[1]), 0.08), (0.6 * k, 0.0, 0.14), yaw[1]))
    return boxes


def _shelf(rng: np.random.Generator) -> list[RigidObject]:
    """Five boxes on each of two boards; neighbours touch, or are 3 to 40 mm apart."""
    objects = []
    for level in range(2):
        objects.append(_floor(2.0, 0.4 * level, f"board{level}"))
        x = -0.5
        for k in range(5):
            width, depth, height = rng.uniform([0.05, 0.1, 0.1], [0.2, 0.25, 0.3]).tolist()
            objects.append(_box(f"o{level}{k}", (width, depth, height), (x + width / 2, 0.0, 0.4 * level + height / 2)))
            x += width + float(rng.choice([0.0, rng.uniform(0.003, 0.04)]))
    return objects


KINDS: dict[str, Callable[[np.random.Generator], list[RigidObject]]] = {
    "pallet": _pallet,
    "stacks": _stacks,
    "shelf": _shelf,
}


def touching(analysis: Analysis) -> frozenset[tuple[int, int]]:
    """The pairs that touch."""
    index = analysis.assembly.index
    ids = [item.id for item in analysis.assembly.objects]
    return frozenset((index[ids[each.first]], index[ids[each.second]]) for each in analysis.structure.interfaces)


@dataclass
class TrackedTally:
    """What the frames of one scene came to: s of processor time, changes of what touches, errors of the push."""

    frames: list[tuple[float, float, float]] = field(default_factory=list)
    draws: list[float] = field(default_factory=list)
    changes: list[int] = field(default_factory=lambda: [0, 0])
    refused: int = 0
    errors: list[float] = field(default_factory=list)
    last: list[frozenset[tuple[int, int]] | None] = field(default_factory=lambda: [None, None])

    def seen_touching(self, *analyses: Analysis) -> None:
        """Count a change of what touches, without and with memory."""
        for number, analysis in enumerate(analyses):
            pairs = touching(analysis)
            self.changes[number] += self.last[number] not in (None, pairs)
            self.last[number] = pairs

    def row(self, kind: str) -> str:
        whole = 1e3 * np.sum(self.frames, axis=1)
        each = "; ".join(f"{1e3 * value:.0f}" for value in np.median(self.frames, axis=0))
        cells = [
            f"{whole.min():.0f} to {whole.max():.0f}, median {np.median(whole):.0f} ({each})",
            f"{1e3 * np.median(self.draws):.0f}" if self.draws else "-",
            f"{self.changes[0]} / {self.changes[1]}",
            str(self.refused),
            f"{np.median(self.errors):.1%}" if self.errors else "-",
        ]
        return f"| {kind} | {' | '.join(cells)} |"


def tracked(kind: str, frames: int, rng: np.random.Generator, samples: int) -> TrackedTally:
    """The frames of one scene."""
    clean, tally = Assembly(tuple(KINDS[kind](rng)), _GRAVITY), TrackedTally()
    push = random_pushes(clean, rng)[:1]
    truth = assess(clean, push).results[0].robustness
    before: Assembly | None = None
    known: Analysis | None = None
    for _ in range(frames):
        noisy = seen(clean, rng, "gauss")
        start = time.process_time()
        try:
            scene = settle(noisy, before)
            settled_at = time.process_time()
            known = analysis_after(known, scene.assembly)
            standing = known.stability()
            analysed_at = time.process_time()
            found = assess(known, carried(push, clean, scene.assembly))
        except PoiseError:
            tally.refused += 1
            continue
        tally.frames.append((settled_at - start, analysed_at - settled_at, time.process_time() - analysed_at))
        if standing.stable and np.isfinite(truth):
            tally.errors.append(abs(found.results[0].robustness / truth - 1))
        before = scene.assembly
        tally.seen_touching(Analysis.of(settle(noisy).assembly), known)
        if samples:
            start = time.process_time()
            assess_settled(scene, carried(push, clean, noisy), samples=samples, analysis=known)
            tally.draws.append((time.process_time() - start) / samples)
    return tally


def main() -> None:
    """Print a table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--frames", type=int, default=40, help="of each scene")
    parser.add_argument("--samples", type=int, default=0, help="draws per frame, to time them")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--seed", type=int, default=11)
    options = parser.parse_args()
    columns = "CPU of a frame, ms (settle; analyse; push) | of a draw | pairs changed without / with memory | refused"
    print(f"| scene | {columns} | error |")
    print("| --- | --- | --- | --- | --- | --- |")
    for kind in options.kinds:
        rng = np.random.default_rng([options.seed, list(KINDS).index(kind)])
        print(tracked(kind, options.frames, rng, options.samples).row(kind), flush=True)


if __name__ == "__main__":
    main()
