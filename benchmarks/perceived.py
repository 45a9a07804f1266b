"""Scenes as a camera sees them: settled, and asked for robustness, against the same scenes without noise.

    python -m benchmarks.perceived                     # 100 scenes of each kind, about ten minutes
    python -m benchmarks.perceived --noise heavy edge  # other errors than those stated
    python -m benchmarks.perceived --only time         # settling 30 objects
    python -m benchmarks.perceived --only threads      # with one thread of OpenBLAS and with its default, in turn

Random stacks, shelves and pallets are the truth. Their poses get errors of 2 mm and 0.5 degrees. The same noisy scenes
are also read without settling, which is the rival.
"""

import argparse
import contextlib
import inspect
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from poise.assembly import (
    Assembly,
    Box,
    Cylinder,
    Push,
    RigidObject,
    acceleration_limits,
    assess,
    assess_settled,
    settle,
)
from poise.assembly.robustness import carried
from poise.assembly.scene import pose_covariance_of, with_pose_covariance
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about, rotation_of_vector
from poise.types import Array

POSITION, ROTATION = 0.002, float(np.radians(0.5))
"""One sigma, m and rad."""
CLOSE = 0.1
"""Relative error of a robustness that is near the clean scene's."""
PUSHES = 3
_GRAVITY = np.array([0.0, 0.0, -9.81])


def _gauss(rng: np.random.Generator) -> Array:
    return rng.normal(size=6)


def _heavy(rng: np.random.Generator) -> Array:
    return np.asarray(rng.standard_t(3, size=6) / np.sqrt(3))


def _edge(rng: np.random.Generator) -> Array:
    return np.asarray(rng.choice([-1.0, 1.0], size=6) * rng.uniform(2.5, 3.0, size=6))


def _mixed(rng: np.random.Generator) -> Array:
    return np.asarray(rng.normal(size=6) * rng.choice([0.3, 1.38]))


NOISE: dict[str, Callable[[np.random.Generator], Array]] = {
    "gauss": _gauss,
    "heavy": _heavy,
    "edge": _edge,
    "mixed": _mixed,
}
"""Errors of six coordinates in standard deviations: as stated; Student's t with three degrees of freedom and the same
variance; each coordinate 2.5 to 3 sigma off; and objects seen well beside objects seen badly."""


def _at(x: float, y: float, z: float, yaw: float = 0.0) -> Pose:
    return Pose(rotation_about([0.0, 0.0, 1.0], yaw), np.array([x, y, z]))


def _fixed(name: str, size: tuple[float, float, float], pose: Pose) -> RigidObject:
    return RigidObject(name, Box(size), pose, fixed=True)


def _stack(rng: np.random.Generator) -> list[RigidObject]:
    """Two to five boxes and cans on a floor, each within the one under it by a quarter of its size."""
    objects, z, place, size = [_fixed("floor", (4, 4, 0.1), _at(0, 0, -0.05))], 0.0, np.zeros(2), 0.3
    for k in range(int(rng.integers(2, 6))):
        yaw, height = float(rng.uniform(-np.pi, np.pi)), float(rng.uniform(0.04, 0.2))
        if rng.random() < 0.25:
            radius = float(rng.uniform(0.04, 0.09))
            shape: Box | Cylinder = Cylinder(radius, height)
            small = 1.4 * radius
        else:
            x, y = rng.uniform(0.1, 0.3, 2)
            shape, small = Box((float(x), float(y), height)), float(min(x, y))
        place = place + rng.uniform(-0.25, 0.25, 2) * min(size, small)
        size = small
        pose = _at(float(place[0]), float(place[1]), z + height / 2, yaw)
        objects.append(RigidObject(f"b{k}", shape, pose, mass=float(rng.uniform(0.3, 3))))
        z += height
    return objects


def _shelf(rng: np.random.Generator) -> list[RigidObject]:
    """Boxes side by side on two boards between walls: half of the neighbours touch, others are 3 to 40 mm apart."""
    objects = [
        _fixed("back", (1.2, 0.02, 0.9), _at(0, 0.2, 0.45)),
        _fixed("left", (0.02, 0.4, 0.9), _at(-0.61, 0, 0.45)),
        _fixed("right", (0.02, 0.4, 0.9), _at(0.61, 0, 0.45)),
    ]
    for level in range(2):
        top = 0.1 + 0.4 * level
        objects.append(_fixed(f"board{level}", (1.2, 0.36, 0.02), _at(0, 0, top - 0.01)))
        x = -0.6 + float(rng.choice([0.0, rng.uniform(0.003, 0.1)]))
        for k in range(int(rng.integers(2, 5))):
            width, depth, height = rng.uniform([0.05, 0.1, 0.1], [0.2, 0.25, 0.3])
            y = float(rng.uniform(-0.04, 0.04))
            pose = _at(x + width / 2, y, top + height / 2)
            size = (float(width), float(depth), float(height))
            objects.append(RigidObject(f"o{level}{k}", Box(size), pose, mass=float(rng.uniform(0.2, 2))))
            x += width + float(rng.choice([0.0, rng.uniform(0.003, 0.04)]))
    return objects


def _pallet(rng: np.random.Generator) -> list[RigidObject]:
    """Two or three layers of equal cartons that touch on all sides."""
    x, y, z = (float(value) for value in rng.uniform([0.15, 0.12, 0.08], [0.4, 0.3, 0.3]))
    along, across, layers = (int(rng.integers(1, 4)) for _ in range(3))
    return cartons(along, across + 1, layers + 1 if along < 3 else 2, (x, y, z), float(rng.uniform(0.5, 5)))


def cartons(along: int, across: int, layers: int, size: tuple[float, float, float], mass: float) -> list[RigidObject]:
    """Equal cartons on a pallet."""
    x, y, z = size
    return [
        _fixed(
            "pallet", (along * x + 0.1, across * y + 0.1, 0.14), _at((along - 1) * x / 2, (across - 1) * y / 2, -0.07)
        ),
        *(
            RigidObject(f"c{k}{i}{j}", Box(size), _at(i * x, j * y, (k + 0.5) * z), mass=mass)
            for k in range(layers)
            for i in range(along)
            for j in range(across)
        ),
    ]


KINDS = {"stack": _stack, "shelf": _shelf, "pallet": _pallet}


def seen(clean: Assembly, rng: np.random.Generator, noise: str) -> Assembly:
    """The assembly with errors on all poses that are not fixed, and with the uncertainty stated for them."""
    objects = []
    for item in clean.objects:
        if not item.fixed:
            error = NOISE[noise](rng) * np.repeat([POSITION, ROTATION], 3)
            turn = rotation_of_vector(error[3:])
            item = replace(item, pose=Pose(turn @ item.pose.rotation, item.pose.translation + error[:3]))
        objects.append(item)
    return replace(clean, objects=with_pose_covariance(objects, pose_covariance_of(POSITION, ROTATION)))


def random_pushes(assembly: Assembly, rng: np.random.Generator) -> list[Push]:
    """Horizontal pushes at points of the sides of random objects."""
    movable = [item for item in assembly.objects if not item.fixed]
    pushes = []
    for number in rng.integers(len(movable), size=PUSHES).tolist():
        item = movable[number]
        if isinstance(item.shape, Cylinder):
            angle = rng.uniform(-np.pi, np.pi)
            outward = np.array([np.cos(angle), np.sin(angle), 0.0])
            point = item.shape.radius * outward + [0, 0, rng.uniform(-0.4, 0.4) * item.shape.length]
        else:
            half, axis = np.array(item.shape.polyhedron.vertices).max(axis=0), int(rng.integers(2))
            outward = np.zeros(3)
            outward[axis] = rng.choice([-1.0, 1.0])
            point = rng.uniform(-0.8, 0.8, 3) * half
            point[axis] = outward[axis] * half[axis]
        pushes.append(Push(item.id, item.pose.apply(point), tuple(-item.pose.rotation @ outward)))
    return pushes


@dataclass
class PerceivedTally:
    """What came of the scenes of one kind and one noise."""

    scenes: int = 0
    rival: int = 0
    answered: int = 0
    errors: list[float] = field(default_factory=list)
    inside: list[bool] = field(default_factory=list)
    widths: list[float] = field(default_factory=list)
    settling: list[float] = field(default_factory=list)
    seconds: float = 0.0
    refusals: list[str] = field(default_factory=list)

    def row(self, kind: str, noise: str) -> str:
        errors = np.array(self.errors or [np.nan])
        cells = [
            f"{self.rival} of {self.scenes}",
            f"{self.answered} of {self.scenes}",
            f"{np.median(errors):.1%}, {np.mean(errors <= CLOSE):.0%}",
            f"{sum(self.inside)} of {len(self.inside)}",
            f"{np.median(self.widths or [np.nan]):.0%}",
            f"{np.median(self.settling or [np.nan]) * 1e3:.0f}",
            f"{self.seconds:.0f}",
        ]
        return f"| {kind} | {noise} | {' | '.join(cells)} |"


def clean_scenes(kind: str, rng: np.random.Generator) -> Iterator[Assembly]:
    """Random scenes that stand."""
    while True:
        made = Assembly(tuple(KINDS[kind](rng)), _GRAVITY, float(rng.uniform(0.3, 0.7)))
        if assess(made, []).stable:
            yield made


def compare(clean: Assembly, rng: np.random.Generator, noise: str, samples: int, tally: PerceivedTally) -> None:
    """Add one scene to a tally."""
    noisy, truth_pushes = seen(clean, rng, noise), random_pushes(clean, rng)
    truth = assess(clean, truth_pushes).results
    moved = carried(truth_pushes, clean, noisy)
    tally.scenes += 1
    with contextlib.suppress(PoiseError):
        tally.rival += assess(noisy, moved).stable
    start = time.process_time()
    try:
        scene = settle(noisy)
        tally.settling.append(time.process_time() - start)
        found = assess_settled(scene, moved, samples=samples)
    except PoiseError as error:
        tally.refusals.append(error.message)
        return
    tally.seconds += time.process_time() - start
    tally.answered += found.settled.stable
    if not found.settled.stable:
        tally.refusals.append(f"does not stand: {', '.join(found.settled.falling)}")
        return
    for true, result, low, high in zip(truth, found.settled.results, found.lower, found.upper, strict=True):
        if not np.isfinite(true.robustness):
            continue
        tally.errors.append(abs(result.robustness / true.robustness - 1))
        if samples:
            tally.inside.append(bool(low <= true.robustness <= high))
            tally.widths.append((high - low) / true.robustness)


def settling_time(seed: int, repeats: int = 10) -> str:
    """ms of processor time for settling 30 objects: cartons that all touch, ten stacks of three, and a shelf."""
    rng = np.random.default_rng(seed)
    stacks = [_fixed("floor", (9, 9, 0.1), _at(0, 0, -0.05))]
    for k in range(30):
        pose = _at(0.5 * (k % 10), 0.0, 0.05 + 0.1 * (k // 10), float(rng.uniform(-3, 3)))
        stacks.append(RigidObject(f"b{k}", Box((0.2, 0.15, 0.1)), pose, mass=1.0))
    words = []
    for name, objects in (("30 cartons", cartons(5, 2, 3, (0.2, 0.15, 0.1), 1.0)), ("ten stacks of three", stacks)):
        times = []
        for _ in range(repeats):
            noisy = seen(Assembly(tuple(objects), _GRAVITY), rng, "gauss")
            start = time.process_time()
            settle(noisy)
            times.append(time.process_time() - start)
        words.append(f"{name} {min(times) * 1e3:.0f}-{max(times) * 1e3:.0f} ms, median {np.median(times) * 1e3:.0f}")
    return "; ".join(words)


def cost_of_threads(seed: int, repeats: int = 10) -> str:
    """ms of processor time and of time, least to greatest, of two questions in one thread and in the default number."""
    rng = np.random.default_rng(seed)
    size = (0.2, 0.15, 0.1)
    small, large = (Assembly(tuple(cartons(*count, size, 1.0)), _GRAVITY) for count in ((5, 2, 3), (5, 4, 5)))
    noisy = seen(small, rng, "gauss")
    free_settle, free_limits = inspect.unwrap(settle), inspect.unwrap(acceleration_limits)
    questions: list[tuple[str, int, Callable[[], object], Callable[[], object]]] = [
        ("settling 30 cartons", repeats, lambda: settle(noisy), lambda: free_settle(noisy)),
        (
            "4 limits of a pallet of 100",
            3,
            lambda: acceleration_limits(large, 4, turning=False),
            lambda: free_limits(large, 4, turning=False),
        ),
    ]
    lines = []
    for name, times_asked, limited, free in questions:
        spent: dict[bool, list[tuple[float, float]]] = {True: [], False: []}
        for number in range(2 * times_asked + 1):
            one = number % 2 == 0
            start = time.process_time(), time.perf_counter()
            (limited if one else free)()
            if number:  # the first one fills caches
                spent[one].append((time.process_time() - start[0], time.perf_counter() - start[1]))
        for one, times in spent.items():
            low, middle, high = np.array([np.min(times, 0), np.median(times, 0), np.max(times, 0)]) * 1e3
            words = [f"{low[k]:.0f}-{high[k]:.0f} ms, median {middle[k]:.0f}" for k in (0, 1)]
            lines.append(f"{name}, {'one thread' if one else 'default'}: processor {words[0]}; time {words[1]}")
    return "\n".join(lines)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=100, help="of each kind")
    parser.add_argument("--samples", type=int, default=59, help="of each interval; 0: no intervals")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--noise", nargs="+", choices=NOISE, default=["gauss"])
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=["time", "threads"])
    parser.add_argument("--refusals", action="store_true", help="print why scenes were not answered")
    options = parser.parse_args()
    if options.only == "threads":
        print(cost_of_threads(options.seed))
        return
    print(f"settling 30 objects: {settling_time(options.seed)}")
    if options.only:
        return
    print(
        "| scenes | noise | rival answered | answered | error: median, within 10 % | inside | width | settling ms | s |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- | --- | --- |")
    for noise in options.noise:
        for number, kind in enumerate(options.kinds):
            rng = np.random.default_rng([options.seed, number, list(NOISE).index(noise)])
            tally, scenes = PerceivedTally(), clean_scenes(kind, rng)
            for _ in range(options.scenes):
                compare(next(scenes), rng, noise, options.samples, tally)
            print(tally.row(kind, noise), flush=True)
            if options.refusals:
                print(*tally.refusals, sep="\n", flush=True)


if __name__ == "__main__":
    main()
