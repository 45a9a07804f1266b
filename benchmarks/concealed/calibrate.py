"""What the probabilities are worth: `python -m benchmarks.concealed.calibrate DIR ... [--foreign DIR ...]`.

Fits the weights of `poise.mismatch.answer.belief_probability` on answers to cases of two generators: DIR of
benchmarks.concealed (seeds `calibration`), and DIR of benchmarks.foreign (seeds `calibration`, and older final ones).
A half of the cases is fitted and the other half judges, then the halves change places; each folder judges the weights
of the others. The weights of all together go into belief.py.
"""

import argparse
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import minimize

from benchmarks.concealed.run import ANSWERS
from benchmarks.concealed.score import read_json
from benchmarks.concealed.seals import open_seals, private_file
from benchmarks.concealed.table import brier, calibration_error
from benchmarks.concealed.tally import judge
from benchmarks.foreign.seals import unseal
from poise.mismatch.answer import BeliefBasis, belief_probability
from poise.types import Array

PRIOR_MEAN, PRIOR_WIDTH = np.array([0.0, 1.0, 0.0, -2.0, 1.0]), np.array([5.0, 1.0, 1.0, 1.5, 1.0])
"""One sigma of the weights' prior: what is never seen must not become infinitely sure, and rivals that do as well are
equal until many cases say otherwise."""


@dataclass(frozen=True)
class Stated:
    """A name that the tool gave: what it is based on, is it true, its probability, its case and its folder."""

    basis: BeliefBasis
    true: bool
    said: float
    case: int
    folder: Path


def stated(concealed: Iterable[Path], foreign: Iterable[Path]) -> list[Stated]:
    """Every name of all answers in some folders."""
    folders = [(folder, _concealed) for folder in concealed] + [(folder, _foreign) for folder in foreign]
    return [
        Stated(BeliefBasis(**effect["basis"]), effect["name"] in known, effect["probability"], number, folder)
        for folder, read in folders
        for number, (known, effects) in enumerate(read(folder))
        for effect in effects
    ]


def _concealed(folder: Path) -> Iterator[tuple[set[str], list[dict[str, Any]]]]:
    """(true names, names given) of each case."""
    for case, label in sorted(open_seals(folder, private_file(folder)).items()):
        answer = read_json(folder / ANSWERS / f"{case}.json")
        if answer is not None:
            known = set(judge(case, label, answer).truth) | set(label["accept"])
            doubtful = set(label["accept"]) if label["kind"] == "foreign" else set()
            yield known, [e for e in answer["effects"] if e["basis"] is not None and e["name"] not in doubtful]


def _foreign(folder: Path) -> Iterator[tuple[set[str], list[dict[str, Any]]]]:
    for case, label in sorted(unseal(folder).items()):
        outcome = read_json(folder / ANSWERS / f"{case}.json") or {}
        known = {name for effect in label["effects"] for name in (effect["name"], *effect["accept"])}
        effects = (outcome.get("answer") or {}).get("effects") or []
        yield known, [effect for effect in effects if effect["basis"] is not None]


def fitted(names: Sequence[Stated]) -> Array:
    """(5,) most likely weights, with a normal prior."""

    def loss(weights: Array) -> float:
        likelihood = [each if name.true else 1.0 - each for name, each in zip(names, said(names, weights), strict=True)]
        return float(-np.sum(np.log(likelihood)) + 0.5 * np.sum(((weights - PRIOR_MEAN) / PRIOR_WIDTH) ** 2))

    return np.asarray(minimize(loss, PRIOR_MEAN, method="Powell").x)


def said(names: Sequence[Stated], weights: Array) -> list[float]:
    """The probabilities of names."""
    return [belief_probability(name.basis, weights.tolist()) for name in names]


def judged(names: Sequence[Stated], probabilities: Sequence[float]) -> str:
    """Expected calibration error and Brier's score."""
    pairs = [(each, name.true) for each, name in zip(probabilities, names, strict=True)]
    return f"{len(pairs)} names, calibration error {calibration_error(pairs):.3f}, Brier {brier(pairs):.3f}"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("concealed", type=Path, nargs="+", help="folders of benchmarks.concealed")
    parser.add_argument("--foreign", type=Path, nargs="*", default=[], help="folders of benchmarks.foreign")
    arguments = parser.parse_args()
    names = stated(arguments.concealed, arguments.foreign)
    print(f"as stated: {judged(names, [name.said for name in names])}")
    folders = (*arguments.concealed, *arguments.foreign)
    parts = {f"half {half}": [name.case % 2 == half for name in names] for half in (0, 1)}
    parts |= {str(folder): [name.folder == folder for name in names] for folder in folders} if folders[1:] else {}
    for what, among in parts.items():
        judges = [name for name, there in zip(names, among, strict=True) if there]
        others = [name for name, there in zip(names, among, strict=True) if not there]
        print(f"{what}, not fitted: {judged(judges, said(judges, fitted(others)))}")
    print("WEIGHTS =", tuple(fitted(names).round(2).tolist()))


if __name__ == "__main__":
    main()
