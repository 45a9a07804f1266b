"""What the probabilities are worth: `python -m benchmarks.concealed.calibrate DIR ... [--foreign DIR ...]`.

Fits the weights of `poise.mismatch.answer.belief` (Platt's scaling: logistic in what speaks for a name) on answers to
cases of two generators that serve no other purpose: DIR of benchmarks.concealed (seeds `calibration`), and DIR of
benchmarks.foreign (seeds `dev`). A half of the cases is fitted and the other half judges, then the halves change
places, and each generator judges the weights of the other; the weights of all together go into belief.py.
"""

import argparse
from collections.abc import Iterator
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
from poise.mismatch.answer import MAX_PROBABILITY, BeliefBasis
from poise.types import Array, Mask

WIDTH = 3.0
"""One sigma of the weights' prior: what is never seen must not become infinitely sure."""


@dataclass(frozen=True, eq=False)
class Stated:
    """Names that the tool gave: what speaks for each (K, p), its rivals (K,), is it true (K,), its probability (K,).

    `case` and `source` (K,) number the cases and the generators.
    """

    speaks: Array
    rivals: Array
    true: Mask
    said: Array
    case: Array
    source: Array


def stated(concealed: list[Path], foreign: list[Path]) -> Stated:
    """Every name of all answers in some folders."""
    rows = []
    for source, folders in enumerate((concealed, foreign)):
        for folder in folders:
            for number, (known, effects) in enumerate(_concealed(folder) if source == 0 else _foreign(folder)):
                for effect in effects:
                    basis = BeliefBasis(**effect["basis"])
                    rows.append(
                        (*basis.terms, basis.rivals, effect["name"] in known, effect["probability"], number, source)
                    )
    table = np.array(rows, dtype=np.float64)
    return Stated(table[:, :-5], table[:, -5], table[:, -4] > 0.5, table[:, -3], table[:, -2], table[:, -1])


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


def fitted(names: Stated, among: Mask) -> Array:
    """(p,) most likely weights, with a normal prior."""

    def loss(weights: Array) -> float:
        probability = probabilities(names, weights)[among]
        likelihood = np.where(names.true[among], probability, 1.0 - probability)
        return float(-np.sum(np.log(np.maximum(likelihood, 1e-12))) + 0.5 * np.sum((weights / WIDTH) ** 2))

    return np.asarray(minimize(loss, np.zeros(names.speaks.shape[1]), method="BFGS").x)


def probabilities(names: Stated, weights: Array) -> Array:
    """(K,) that the names are true: the library holds the truth, and the rivals share it."""
    library = 1.0 / (1.0 + np.exp(-names.speaks @ weights))
    return np.asarray(np.minimum(library / (1.0 + names.rivals), MAX_PROBABILITY))


def judged(names: Stated, among: Mask, weights: Array) -> tuple[float, float]:
    """Expected calibration error and Brier's score of weights on names they were not fitted to."""
    chosen = zip(probabilities(names, weights)[among], names.true[among], strict=True)
    pairs = [(float(p), bool(t)) for p, t in chosen]
    return calibration_error(pairs) or 0.0, brier(pairs) or 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("concealed", type=Path, nargs="+", help="folders of benchmarks.concealed")
    parser.add_argument("--foreign", type=Path, nargs="*", default=[], help="folders of benchmarks.foreign")
    arguments = parser.parse_args()
    names = stated(arguments.concealed, arguments.foreign)
    print(f"{len(names.true)} names, {names.true.mean():.3f} of them true")
    pairs = [(float(p), bool(t)) for p, t in zip(names.said, names.true, strict=True)]
    print(f"as stated: calibration error {calibration_error(pairs):.3f}, Brier {brier(pairs):.3f}")
    parts = {f"half {half}": names.case % 2 == half for half in (0, 1)}
    parts |= {what: names.source == k for k, what in enumerate(("concealed", "foreign"))} if arguments.foreign else {}
    for what, judges in parts.items():
        error, square = judged(names, judges, fitted(names, ~judges))
        print(f"{what}, not fitted: {judges.sum()} names, calibration error {error:.3f}, Brier {square:.3f}")
    print("WEIGHTS =", tuple(fitted(names, np.ones(len(names.true), dtype=bool)).round(2).tolist()))


if __name__ == "__main__":
    main()
