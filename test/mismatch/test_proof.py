"""No name without proof: physical bounds, blocks that no fit sees, and the error on held-out samples."""

from functools import cache

import numpy as np
import pytest
from cases import make_case

from poise.mismatch.effects import Effect, EffectParameter, Values, effect_named
from poise.mismatch.inference import Problem, names, search, wrench_problem
from poise.mismatch.recorded import RecordedMotion
from poise.types import Array


class Pull(Effect):
    """A force along the sensor's x that grows from zero, at most `most`."""

    name = "pull"
    layer = "sensor"
    equation = source = excited_by = separating_motion = "of a test"

    def __init__(self, most: float) -> None:
        self._most = most

    def parameters(self, recorded: RecordedMotion) -> tuple[EffectParameter, ...]:
        return (EffectParameter("force", "N", 2.0, low=0.0, high=self._most),)

    def columns(self, recorded: RecordedMotion, nonlinear: Values) -> Array:
        out = np.zeros((len(recorded), 6, 1))
        out[:, 0, 0] = np.sin(recorded.seconds)
        return out

    def sentence(self, recorded: RecordedMotion, values: Values) -> str:
        return f"{values['force']:.1f} N"


def pulled(force: float) -> Problem:
    """A recording in which something pulls."""
    return wrench_problem(_pulled(force), make_case(5, duration=8.0).model)


@cache
def _pulled(force: float) -> RecordedMotion:
    def spoil(exact: RecordedMotion, wrench: Array, rng: np.random.Generator) -> Array:
        del wrench, rng
        return Pull(np.inf).simulate(exact, {"force": force})

    return make_case(5, duration=8.0, spoil=spoil).recorded()


@pytest.mark.parametrize(("force", "most", "found"), [(3.0, 5.0, ("pull",)), (3.0, 1.0, ()), (-3.0, 5.0, ())])
def test_a_fit_outside_the_physical_bounds_is_no_answer(force: float, most: float, found: tuple[str, ...]) -> None:
    _, best = search(pulled(force), [Pull(most)])
    assert tuple(name for name in names(best) if not name.startswith("unknown")) == found


IMPOSSIBLE = {
    "sensor_gain": {"gain_fx_fx": 0.7},
    "sensor_nonlinearity": {"cubic_fz": -0.1},
    "sensor_creep": {"fraction": -0.8},
    "joint_offset": {"offset_2": 0.6},
    "base_tilt": {"rotation_x": 0.49999},
    "sensor_rotation": {"rotation_z": -0.49999},
    "payload_parameters": {"mass": -9.0},
    "mass_step": {"moment_y": 20.0},
    "mass_leak": {"rate": 9.0},
}


def values_of(effect: Effect, recorded: RecordedMotion) -> dict[str, float]:
    """Typical values: linear ones a tenth of their size, others in the middle of their range."""
    return {
        p.name: 0.1 * p.scale if p.linear else p.from_unit(0.5 if np.isfinite(p.low + p.high) else 0.0)
        for p in effect.parameters(recorded)
    }


@pytest.mark.parametrize("name", IMPOSSIBLE)
def test_bounds_hold_for_impossible_values_alone(name: str) -> None:
    recorded, effect = _pulled(3.0), effect_named(name)
    assert effect is not None
    usual = values_of(effect, recorded)
    assert effect.implausible(recorded, usual) == ""
    assert effect.implausible(recorded, usual | IMPOSSIBLE[name])
