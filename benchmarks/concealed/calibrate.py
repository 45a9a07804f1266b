"""What the probabilities are worth: `python -m benchmarks.concealed.calibrate DIR DIR.seals.json`.

Fits the weights of `poise.mismatch.answer.belief` (Platt's scaling: logistic in what speaks for a name) on answers to
recordings made with the seeds `calibration`. A half of the cases is fitted and the other half judges, then the halves
change places; the weights of all cases together go into belief.py.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.optimize import minimize

from benchmarks.concealed.run import ANSWERS
from benchmarks.concealed.score import read_json
from benchmarks.concealed.seals import open_seals
from benchmarks.concealed.table import brier, calibration_error
from benchmarks.concealed.tally import judge
from poise.mismatch.answer import MAX_PROBABILITY, BeliefBasis
from poise.types import Array

WIDTH = 3.0
"""One sigma of the weights' prior: what is never seen must not become infinitely sure."""


def stated(folder: Path, private: Path) -> tuple[Array, Array, Array, Array]:
    """Of every name given: number of its case, what speaks for it (K, p), was it true, and the stated probability."""
    rows = []
    for number, (case, label) in enumerate(sorted(open_seals(folder, private).items())):
        answer = read_json(folder / ANSWERS / f"{case}.json")
        if answer is None:
            continue
        verdict = judge(case, label, answer)
        known = set(verdict.truth) | set(label["accept"])
        for effect in answer["effects"]:
            if effect["basis"] is None or (label["kind"] == "foreign" and effect["name"] in label["accept"]):
                continue
            rows.append((number, *BeliefBasis(**effect["basis"]).terms, effect["name"] in known, effect["probability"]))
    table = np.array(rows, dtype=np.float64)
    return table[:, 0].astype(int), table[:, 1:-2], table[:, -2], table[:, -1]


def fitted(speaks: Array, true: Array) -> Array:
    """(p,) most likely weights, with a normal prior."""

    def loss(weights: Array) -> float:
        odds = speaks @ weights
        return float(np.sum(np.logaddexp(0.0, odds) - true * odds) + 0.5 * np.sum((weights / WIDTH) ** 2))

    return np.asarray(minimize(loss, np.zeros(speaks.shape[1]), method="BFGS").x)


def judged(speaks: Array, true: Array, weights: Array) -> tuple[float, float]:
    """Expected calibration error and Brier's score of weights on names they were not fitted to."""
    probability = np.minimum(1.0 / (1.0 + np.exp(-speaks @ weights)), MAX_PROBABILITY)
    pairs = [(float(p), bool(t)) for p, t in zip(probability, true, strict=True)]
    return calibration_error(pairs) or 0.0, brier(pairs) or 0.0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("seals", type=Path)
    arguments = parser.parse_args()
    case, speaks, true, said = stated(arguments.folder, arguments.seals)
    print(f"{len(true)} names, {true.mean():.3f} of them true")
    pairs = [(float(p), bool(t)) for p, t in zip(said, true, strict=True)]
    print(f"as stated: calibration error {calibration_error(pairs):.3f}, Brier {brier(pairs):.3f}")
    for half in (0, 1):
        learnt = case % 2 == half
        error, square = judged(speaks[~learnt], true[~learnt], fitted(speaks[learnt], true[learnt]))
        print(f"fitted to the other half ({learnt.sum()} names): calibration error {error:.3f}, Brier {square:.3f}")
    print("WEIGHTS =", tuple(fitted(speaks, true).round(2).tolist()))


if __name__ == "__main__":
    main()
