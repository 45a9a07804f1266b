"""An effect of the load on joint efforts is the same effect: what it says of itself is passed on."""

import inspect

import pytest

from poise.mismatch.effects import Effect, all_effects
from poise.mismatch.reading.load_on_efforts import acting_on_efforts

_PAIRS = [(known, shown) for known in all_effects() if (shown := acting_on_efforts(known)) is not None]
_METHODS = [name for name, _ in inspect.getmembers(Effect, inspect.isfunction) if not name.startswith("_")]
_LINEAR = {"base_tilt": {"starts"}}
"""Methods that an effect does not need on efforts, where it is linear."""


@pytest.mark.parametrize(("known", "shown"), _PAIRS, ids=[known.name for known, _ in _PAIRS])
def test_what_an_effect_says_of_itself_is_passed_on_to_efforts(known: Effect, shown: Effect) -> None:
    assert not known.direct
    own = {name for name in _METHODS if getattr(type(known), name) is not getattr(Effect, name)}
    passed = {name for name in _METHODS if getattr(type(shown), name) is not getattr(Effect, name)}
    # Where only the columns are overridden, the response is their product with the values.
    assert own - passed <= _LINEAR.get(known.name, set()) | ({"simulate"} if "columns" in passed else set())
    for name in set(Effect.__annotations__) - {"signal", "needs"}:
        assert getattr(shown, name) == getattr(known, name), name
