"""Which law of a contact the search prefers: a plate needs few numbers, a push has no place."""

from collections.abc import Callable

import numpy as np
from cases import make_case

from poise.geometry import sphere_directions
from poise.mismatch.effects import effect_named
from poise.mismatch.effects.plate import PLATE, _values, depth_inside
from poise.mismatch.inference import TimeLimit, wrench_problem
from poise.mismatch.inference.screening import beside
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array

CONTACT = effect_named("contact")
assert CONTACT is not None
_FORCES = {f"force_{axis}_{k}": 0.0 for axis in "xyz" for k in range(15)}
_PUSH = {f"force_z_{k}": 6.0 * np.sin(np.pi * (k + 1) / 8) for k in range(7)}
_POINT = {"x": 0.0, "y": 0.0, "z": 0.17}


def on_plate(at: RecordedMotion) -> Array:
    """The wrench of a plate that the tool touches for less than a tenth of the time."""
    assert CONTACT is not None
    sizes = {"press": 1.4, "damping": 0.0, "rub": 0.6, "law": 1.0, "knots": 7.0, "start": 0.0, "length": 1.0}
    for normal in sphere_directions(60):
        values = _FORCES | sizes | _values(at, normal, np.array(list(_POINT.values())), 0.02)
        if 0.03 < float(np.mean(depth_inside(at, values) > 0.0)) < 0.1:
            return CONTACT.simulate(at, values)
    raise AssertionError("no plate is touched")


def pushed(at: RecordedMotion) -> Array:
    """The wrench of something that pushes once."""
    assert CONTACT is not None
    none = dict.fromkeys(PLATE, 0.0) | {"law": 0.0, "knots": 7.0}
    return CONTACT.simulate(at, none | _FORCES | _PUSH | _POINT | {"start": 5.0, "length": 1.0})


def preferred(add: Callable[[RecordedMotion], Array]) -> tuple[str, float]:
    """The law of the contact that explains most of what was added to a recording, and its evidence."""
    assert CONTACT is not None
    case = make_case(4, duration=15.0, spoil=lambda exact, wrench, rng: add(exact))
    (found,) = beside(wrench_problem(case.recorded(), case.model), (), [CONTACT], TimeLimit())
    return CONTACT.law(found.values), found.gain


def test_the_law_with_more_evidence_is_the_contact() -> None:
    law, gain = preferred(on_plate)
    assert (law, gain > 100.0) == ("plate", True)
    law, gain = preferred(pushed)
    assert (law, gain > 100.0) == ("free", True)
