"""Which cases there are: the mix of kinds, and the chance of each, from the seeds' name and the number of cases."""

from collections.abc import Sequence
from itertools import cycle, islice
from typing import TypeVar

import numpy as np

from benchmarks.concealed.case import Plan
from benchmarks.concealed.changes import DECOYS, EFFORT_EFFECTS, EFFORT_UNKNOWNS, LIBRARY, UNKNOWNS
from benchmarks.concealed.twins import TWINS

SEEDS = {"development": 4_021, "calibration": 60_313, "regression": 73_939, "effects": 8_401, "final": 318_467}
"""First number of every chance. The tool is worked on with `development`, and with `effects` on some of them; its
probabilities come from `calibration`; versions of it are compared on `regression`; nothing is tuned on `final`, and it
is not looked at before a release."""

Item = TypeVar("Item")

SHARES = {"single": 0.52, "pair": 0.12, "null": 0.10, "decoy": 0.10, "twin": 0.05, "foreign": 0.11}
STRENGTHS = (1.0, 0.3)

# Both leave marks of their own, and neither hides the other's.
PAIRS = (
    ("sensor_bias", "clock_offset"),
    ("sensor_bias", "mass_step"),
    ("sensor_bias", "loose_part"),
    ("bias_drift", "contact"),
    ("bias_drift", "payload_parameters"),
    ("sensor_gain", "external_vibration"),
    ("sensor_gain", "flywheel"),
    ("sensor_rotation", "cable"),
    ("sensor_rotation", "mass_step"),
    ("low_pass", "payload_parameters"),
    ("clock_offset", "flywheel"),
    ("clock_offset", "world_force"),
    ("clock_skew", "contact"),
    ("quantisation", "mass_step"),
    ("payload_parameters", "contact"),
    ("payload_parameters", "slosh"),
    ("joint_offset", "contact"),
    ("base_tilt", "flywheel"),
    ("base_motion", "sensor_bias"),
    ("air_drag", "mass_leak"),
    ("world_force", "external_vibration"),
    ("cable", "contact"),
    ("mass_step", "external_vibration"),
    ("sensor_creep", "contact"),
    ("viscous_friction", "motor_inertia"),
    ("viscous_friction", "gear_ripple"),
    ("coulomb_friction", "motor_inertia"),
    ("coulomb_friction", "viscous_friction"),
)


def draw_plans(seeds: str, cases: int) -> list[Plan]:
    """All cases in the order of their numbers, which carries no information.

    Args:
        seeds: development or final.
        cases: how many; each kind has its share, each effect its turn.
    """
    rng = np.random.default_rng([SEEDS[seeds], cases])
    entries = [entry for kind, count in _counts(cases).items() for entry in _of_kind(kind, count, rng)]
    order = rng.permutation(len(entries)).tolist()
    numbered = ((number, *entries[place]) for number, place in enumerate(order))
    return [
        Plan(kind, names, strength, effort, seed=(SEEDS[seeds], number))
        for number, kind, names, strength, effort in numbered
    ]


def plans_of(effects: Sequence[str], each: int) -> list[Plan]:
    """Cases of some effects alone, one effect after the other, in turn at every strength.

    Args:
        effects: names. each: cases of every effect.
    """
    return [
        Plan("single", (name,), strength, name in EFFORT_EFFECTS, seed=(SEEDS["effects"], each * i + k))
        for i, name in enumerate(effects)
        for k, strength in enumerate(islice(cycle(STRENGTHS), each))
    ]


def _counts(cases: int) -> dict[str, int]:
    """How many of each kind: shares rounded so that they add up; the largest remainders are rounded up."""
    wanted = {kind: share * cases for kind, share in SHARES.items()}
    counts = {kind: int(value) for kind, value in wanted.items()}
    for kind in sorted(wanted, key=lambda kind: counts[kind] - wanted[kind])[: cases - sum(counts.values())]:
        counts[kind] += 1
    return counts


def _of_kind(kind: str, count: int, rng: np.random.Generator) -> list[tuple[str, tuple[str, ...], float, bool]]:
    if kind == "single":
        once = [(name, strength) for strength in STRENGTHS for name in LIBRARY]
        return [(kind, (name,), strength, name in EFFORT_EFFECTS) for name, strength in _turns(once, count, rng)]
    if kind == "pair":
        return [(kind, pair, 1.0, pair[0] in EFFORT_EFFECTS) for pair in _turns(PAIRS, count, rng)]
    if kind == "null":
        return [(kind, (), 0.0, effort) for effort in _turns((False, False, False, True), count, rng)]
    names = {"decoy": list(DECOYS), "twin": list(TWINS), "foreign": list(UNKNOWNS)}[kind]
    return [(kind, (name,), 1.0, name in EFFORT_UNKNOWNS) for name in _turns(names, count, rng)]


def _turns(items: Sequence[Item], count: int, rng: np.random.Generator) -> list[Item]:
    """`count` items; the counts of any two differ by one at most."""
    rounds = [rng.permutation(len(items)) for _ in range(count // len(items) + 1)]
    return [items[index] for index in np.concatenate(rounds)[:count].tolist()]
