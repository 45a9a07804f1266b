"""Perceived scenes whose assumptions are false: is the answer right, wider, a finding, a refusal, or silently wrong?

    python -m benchmarks.broken_scenes                  # 6 scenes of each kind broken in each way, about five minutes
    python -m benchmarks.broken_scenes --seed 11 --list # what is said of each

Random stacks, shelves and pallets of `benchmarks.perceived` are seen with errors of 2 mm and 0.5 degrees, and each is
broken in every way. The judge is what `assess` says of the true scene, for three pushes. An answer is right if all are
within 10 %, wider if the intervals hold all, a finding if a sentence warns of the scene, refused if there is no answer
or the scene falls, which it does not (with the likely cause, none, or a wrong one); and silently wrong otherwise.
Exits with 1 where a scene that contradicts itself is silently wrong.
"""

import argparse
import sys
from collections import Counter
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from benchmarks.perceived import KINDS, clean_scenes, random_pushes, seen
from poise.assembly import (
    Assembly,
    Box,
    Cylinder,
    FrictionPair,
    Mesh,
    Push,
    RigidObject,
    assess,
    assess_settled,
    settle,
)
from poise.assembly.robustness import carried, likely_cause
from poise.assembly.scene import scene_findings, with_pose_covariance
from poise.baselines.placement import Engine
from poise.errors import PoiseError
from poise.geometry import Pose, rotation_about
from poise.types import Array

OUTCOMES = ("right", "wider", "finding", "cause named", "refused", "wrong cause", "silently wrong")
CLOSE, _STILL = 0.1, 0.005
"""Relative error of what is right; m by which nothing moves that holds."""
_DEG = np.degrees


@dataclass(frozen=True, eq=False)
class Broken:
    """The true scene, and the one that is given."""

    truth: Assembly
    given: Assembly


Break = Callable[[Assembly, Assembly, np.random.Generator], Broken]
"""Of the true scene and the one seen."""


def _movable(scene: Assembly) -> list[int]:
    return [place for place, item in enumerate(scene.objects) if not item.fixed]


def _one(change: Callable[[RigidObject, np.random.Generator], RigidObject]) -> Break:
    """One random object is changed where it is seen."""

    def broken(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
        place, items = int(rng.choice(_movable(given))), list(given.objects)
        items[place] = change(items[place], rng)
        return Broken(truth, replace(given, objects=tuple(items)))

    return broken


def _each(change: Callable[[RigidObject], RigidObject]) -> Break:
    """All objects are changed where they are seen."""
    return lambda truth, given, _: Broken(truth, replace(given, objects=tuple(map(change, given.objects))))


def _scene(**changes: Callable[[Assembly], object]) -> Break:
    """Entries of the scene are changed."""

    def broken(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
        return Broken(truth, replace(given, **{name: change(given) for name, change in changes.items()}))

    return broken


def _moved(item: RigidObject, by: Array) -> RigidObject:
    return replace(item, pose=Pose(item.pose.rotation, item.pose.translation + by))


def _level(size: float) -> Callable[[RigidObject, np.random.Generator], RigidObject]:
    def moved(item: RigidObject, rng: np.random.Generator) -> RigidObject:
        angle = rng.uniform(-np.pi, np.pi)
        return _moved(item, size * np.array([np.cos(angle), np.sin(angle), 0.0]))

    return moved


def _scaled(item: RigidObject, factor: float) -> RigidObject:
    if isinstance(item.shape, Box):
        return replace(item, shape=Box(tuple(factor * side for side in item.shape.size)))
    if isinstance(item.shape, Cylinder):
        return replace(item, shape=Cylinder(factor * item.shape.radius, factor * item.shape.length))
    return item


def _mesh_in_mm(item: RigidObject, _: np.random.Generator) -> RigidObject:
    solid = item.shape.polyhedron
    return replace(item, shape=Mesh(1000 * np.asarray(solid.vertices), np.asarray(solid.triangles)))


def _in_mm(item: RigidObject) -> RigidObject:
    return replace(_scaled(item, 1000.0), pose=Pose(item.pose.rotation, 1000 * item.pose.translation))


def _w_first(item: RigidObject) -> RigidObject:
    vector = item.pose.vector
    return (
        item if item.fixed else replace(item, pose=Pose.from_vector(np.concatenate([vector[:3], vector[[6, 3, 4, 5]]])))
    )


def _turned(item: RigidObject) -> RigidObject:
    turn = rotation_about([1.0, 0.0, 0.0], -np.pi / 2)
    return replace(item, pose=Pose(turn @ item.pose.rotation, turn @ item.pose.translation))


def _at_bottom(item: RigidObject) -> RigidObject:
    half = np.ptp(item.vertices[:, 2]) / 2
    return item if item.fixed else _moved(item, np.array([0.0, 0.0, -half]))


def _friction_of_pairs(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    names = [item.id for item in truth.objects]
    pairs = tuple(
        FrictionPair((one, other), float(truth.friction_between(one, other) * rng.uniform(0.7, 1.3)))
        for k, one in enumerate(names)
        for other in names[:k]
    )
    return Broken(replace(truth, friction_pairs=pairs), given)


def _without_support(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """What lies lowest under the highest object is missing."""
    movable = _movable(given)
    heights = [given.objects[place].vertices[:, 2].min() for place in movable]
    missing = movable[int(np.argmin(heights))]
    return Broken(truth, replace(given, objects=tuple(item for k, item in enumerate(given.objects) if k != missing)))


def _twice(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    item = given.objects[int(rng.choice(_movable(given)))]
    again = replace(_moved(item, rng.normal(size=3) * 0.003), id=f"{item.id}_again")
    return Broken(truth, replace(given, objects=(*given.objects, again)))


def _noisier(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """The errors are four times those stated."""
    bare = [replace(item, pose_covariance=None) for item in given.objects]
    stated = next(item.pose_covariance for item in given.objects if item.pose_covariance is not None)
    return Broken(truth, replace(given, objects=with_pose_covariance(bare, np.asarray(stated) / 16)))


def _mass_stated(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """All masses have a deviation of 20 %, and one is 30 % off."""
    broken = BREAKS["one mass 30 % off"].change(truth, given, rng)
    items = [item if item.fixed else replace(item, covariance=_of_mass(item, 0.2)) for item in broken.given.objects]
    return Broken(truth, replace(broken.given, objects=tuple(items)))


def _of_mass(item: RigidObject, share: float) -> Array:
    """(10, 10) covariance where only the mass is uncertain, by a share of it; the centre of mass stays."""
    com = item.shape.centroid if item.com is None else item.com
    first = np.concatenate([[1.0], com, np.zeros(6)]) * share * item.mass
    return np.outer(first, first)


def _friction_stated(truth: Assembly, given: Assembly, rng: np.random.Generator) -> Broken:
    """All pairs have a deviation of 20 % of their friction, which is up to 30 % off."""
    broken = _friction_of_pairs(truth, given, rng)
    stated = float(truth.largest_friction)
    pairs = tuple(FrictionPair(pair.objects, stated, 0.2 * stated) for pair in broken.truth.friction_pairs)
    return Broken(broken.truth, replace(given, friction_pairs=pairs))


@dataclass(frozen=True)
class Kind:
    """One way to break a scene.

    Args:
        change: what is done.
        contradicted: whether the scene itself then contradicts it.
        cause: words of the sentence of `likely_cause` that is right; empty where none is.
    """

    change: Break
    contradicted: bool = False
    cause: str = ""


BREAKS: dict[str, Kind] = {
    "as stated": Kind(_scene()),
    "one mass 30 % off": Kind(
        _one(lambda item, rng: replace(item, mass=item.mass * float(rng.choice([0.7, 1.3])))),
    ),
    "the same, 20 % stated": Kind(_mass_stated),
    "friction of contacts 30 % off": Kind(_friction_of_pairs),
    "the same friction, 20 % stated": Kind(_friction_stated),
    "one pose 20 mm off": Kind(_one(_level(0.02))),
    "errors 4 times those stated": Kind(_noisier),
    "support missing": Kind(_without_support, True),
    "one object 5 mm too low": Kind(_one(lambda item, _: _moved(item, np.array([0, 0, -0.005])))),
    "one object 15 mm too low": Kind(_one(lambda item, _: _moved(item, np.array([0, 0, -0.015]))), True),
    "one mesh in mm": Kind(_one(_mesh_in_mm), True, "in mm"),
    "one half size": Kind(_one(lambda item, _: _scaled(item, 0.5)), True),
    "all in mm": Kind(_each(_in_mm), True),
    "half sizes": Kind(_each(lambda item: item if item.fixed else _scaled(item, 0.5)), True, "half as large"),
    "masses in g": Kind(_each(lambda item: replace(item, mass=1000 * item.mass)), True),
    "gravity along y": Kind(_scene(gravity=lambda _: np.array([0.0, -9.81, 0.0])), True, "gravity along -z"),
    "gravity upwards": Kind(_scene(gravity=lambda _: np.array([0.0, 0.0, 9.81])), True, "gravity along -z"),
    "poses with y up": Kind(_each(_turned), True, "y is up"),
    "quaternions w first": Kind(_each(_w_first), True, "w x y z"),
    "poses of the bottom": Kind(_each(_at_bottom), True, "bottoms"),
    "one object twice": Kind(_twice, True, "seen twice"),
    "friction in degrees": Kind(_scene(friction=lambda scene: float(_DEG(np.arctan(scene.friction)))), True),
}
"""By name."""


def outcome_of(
    name: str, truth: Assembly, given: Assembly, pushes: Sequence[Push], rng: np.random.Generator, samples: int
) -> tuple[str, str]:
    """The outcome for a scene that is broken in one way, and the words or numbers that it rests on."""
    try:
        broken = BREAKS[name].change(truth, given, rng)
    except PoiseError as error:
        return "refused", error.message
    return said(broken, pushes, samples, BREAKS[name].cause)


def said(broken: Broken, pushes: Sequence[Push], samples: int, cause: str) -> tuple[str, str]:
    """The outcome for one scene, and the words or numbers that it rests on."""
    truth = assess(broken.truth, pushes)
    if not truth.stable:
        return "", "the true scene falls"
    kept = [k for k, push in enumerate(pushes) if push.object in broken.given.index]
    there = tuple(item for item in broken.truth.objects if item.id in broken.given.index)
    asked = carried([pushes[k] for k in kept], replace(broken.truth, objects=there, friction_pairs=()), broken.given)
    words = [finding.sentence for finding in scene_findings(broken.given)]
    try:
        scene = settle(broken.given)
        found = assess_settled(scene, asked, samples=samples)
    except PoiseError as error:
        return _refused(broken.given, cause), "; ".join([error.message, *words])
    words += [*scene.sentences[1:]] if scene.strain > 1 else []
    if not found.settled.stable:
        falls = f"falls: {', '.join(found.settled.falling)}"
        return _refused(broken.given, cause), "; ".join([falls, *words])
    rows = zip(
        [truth.results[k].robustness for k in kept], found.settled.results, found.lower, found.upper, strict=True
    )
    ratios, held = [], True
    for true, result, low, high in rows:
        if np.isfinite(true) and true > 0:
            ratios.append(result.robustness / true)
            held &= bool(low * (1 - 1e-3) <= true <= high * (1 + 1e-3))
    numbers = " ".join(f"{ratio:.2f}" for ratio in ratios)
    if all(abs(ratio - 1) <= CLOSE for ratio in ratios) and len(kept) == len(pushes):
        return "right", numbers
    if words:
        return "finding", f"{numbers}; {'; '.join(words)}"
    return ("wider" if held else "silently wrong"), numbers


def _refused(scene: Assembly, cause: str) -> str:
    """The outcome of a scene that is refused or falls: whether a cause is named, and the right one."""
    named = likely_cause(scene)
    if named is None:
        return "refused"
    return "cause named" if cause and cause in named else "wrong cause"


def judged(truth: Assembly, pushes: Sequence[Push]) -> Array:
    """(3,) pushes that move something, those of them that hold at 0.9 in MuJoCo, and those that move at 1.15."""
    counts = np.zeros(3, dtype=int)
    for result, push in zip(assess(truth, pushes).results, pushes, strict=True):
        if np.isfinite(result.robustness):
            away = [_moves(truth, push, share * result.robustness) for share in (0.9, 1.15)]
            counts += [1, away[0] < _STILL, away[1] > _STILL]
    return counts


def _moves(scene: Assembly, push: Push, force: float) -> float:
    """m by which something moves in a second while a push grows to a force, N, after the scene has settled."""
    engine = Engine(scene, 1e-3)
    engine.run(0.25)
    before, body = engine.poses, engine.model.body(push.object).id
    lever = np.asarray(push.point) - scene.objects[scene.index[push.object]].com_in_world
    for share in np.linspace(0.1, 1, 10):
        pushed = share * force * np.asarray(push.direction) / np.linalg.norm(push.direction)
        engine.data.xfrc_applied[body] = np.concatenate([pushed, np.cross(lever, pushed)])
        engine.run(0.05)
    engine.run(0.5)
    return engine.moved(before)


def main() -> None:
    """Print the table of docs/robustness.md."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenes", type=int, default=6, help="of each kind")
    parser.add_argument("--samples", type=int, default=19, help="of each interval")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--quick", action="store_true", help="one scene of each kind")
    parser.add_argument("--only", choices=BREAKS)
    parser.add_argument("--list", action="store_true", help="print what is said of each scene")
    parser.add_argument("--engine", action="store_true", help="compare the true scenes with MuJoCo instead")
    options = parser.parse_args()
    counts: dict[str, Counter[str]] = {name: Counter() for name in BREAKS if options.only in (None, name)}
    moved = np.zeros(3, dtype=int)
    for number, kind in enumerate(KINDS):
        rng = np.random.default_rng([options.seed, number])
        scenes = clean_scenes(kind, rng)
        for k in range(1 if options.quick else options.scenes):
            clean = next(scenes)
            given, pushes = seen(clean, rng, "gauss"), random_pushes(clean, rng)
            moved += judged(clean, pushes) if options.engine else 0
            for name in () if options.engine else counts:
                own = np.random.default_rng([options.seed, number, k])
                outcome, words = outcome_of(name, clean, given, pushes, own, options.samples)
                counts[name][outcome] += bool(outcome)
                if options.list:
                    print(f"{name} | {kind} {k} | {outcome} | {words}", flush=True)
    if options.engine:
        print("{} pushes: {} hold at 0.9 of what the true scene withstands, {} move at 1.15 of it".format(*moved))
        return
    print(f"| the scene | {' | '.join(OUTCOMES)} |\n|{' --- |' * (len(OUTCOMES) + 1)}")
    for name, count in counts.items():
        print(f"| {name} | {' | '.join(str(count[outcome]) for outcome in OUTCOMES)} |")
    sys.exit(any(count["silently wrong"] for name, count in counts.items() if BREAKS[name].contradicted))


if __name__ == "__main__":
    main()
