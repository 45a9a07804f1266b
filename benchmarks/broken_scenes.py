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
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from benchmarks.perceived import KINDS, clean_scenes, random_pushes, seen
from benchmarks.scene_breaks import BREAKS, Broken
from poise.assembly import Assembly, Push, assess, assess_settled, settle
from poise.assembly.robustness import EXPLAINED, carried, likely_cause
from poise.assembly.scene import scene_findings
from poise.baselines.placement import Engine
from poise.errors import PoiseError
from poise.types import Array

OUTCOMES = ("right", "wider", "finding", "cause named", "refused", "wrong cause", "silently wrong")
CLOSE, _STILL = 0.1, 0.005
"""Relative error of what is right; m by which nothing moves that holds."""


def outcome_of(
    name: str, truth: Assembly, given: Assembly, pushes: Sequence[Push], rng: np.random.Generator, samples: int
) -> tuple[str, str]:
    """The outcome for a scene that is broken in one way, and the words or numbers that it rests on."""
    try:
        broken = BREAKS[name].change(truth, given, rng)
    except PoiseError as error:
        cause = BREAKS[name].cause
        return "cause named" if cause and cause in error.message else "refused", error.message
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
        words = [error.message, *words]
        return _refused(broken.given, cause, words) if error.code in EXPLAINED else ("refused", "; ".join(words))
    words += [*scene.sentences[1:]] if scene.strain > 1 else []
    if not found.settled.stable:
        return _refused(broken.given, cause, [f"falls: {', '.join(found.settled.falling)}", *words])
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


def _refused(scene: Assembly, cause: str, words: Sequence[str]) -> tuple[str, str]:
    """The outcome of a scene that is refused or falls: whether a cause is named, and the right one; and all words."""
    named = likely_cause(scene)
    said = "; ".join([*words, f"cause: {named}"])
    if cause and cause in said:
        return "cause named", said
    return "refused" if named is None else "wrong cause", said


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
    """Print the table of docs/robustness_results.md."""
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
