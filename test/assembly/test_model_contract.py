"""What every robustness model of the registry has to do, whichever way it computes."""

from dataclasses import replace

import assembly_scenes as scenes
import numpy as np
import pytest
from assembly_scenes import G

from poise.assembly import Analysis, Push, assess, robustness_map
from poise.assembly.robustness.registry import DEFAULT_MODEL, ROBUSTNESS_MODELS
from poise.errors import ErrorCode, InputError

EVERY_MODEL = pytest.mark.parametrize("name", ROBUSTNESS_MODELS.names())
LOW, HIGH = (Push("cube", (-0.5, 0, z), (1, 0, 0)) for z in (0.1, 0.9))
DOWN = Push("cube", (0, 0, 1), (0, 0, -1))


@pytest.fixture
def model(name):
    entry = ROBUSTNESS_MODELS.find(name)
    for module in entry.needs:
        pytest.importorskip(module)
    return entry


@EVERY_MODEL
def test_it_declares_its_name_and_what_it_assumes(name, model):
    assert model.name == name
    assert model.description
    assert bool(model.needs) == bool(model.extra)
    assert ROBUSTNESS_MODELS.find(DEFAULT_MODEL).maps


@EVERY_MODEL
def test_a_cube_slips_and_topples_at_about_the_closed_forms(name, model):
    """Slip at mu m g, topple at m g (a / 2) / h; a push straight down moves nothing."""
    low, down = assess(scenes.cube(), [LOW, DOWN], name).results
    (high,) = assess(replace(scenes.cube(), friction=0.9), [HIGH], name).results
    # The threshold on energy in Algorithm 3 of the thesis detects motion late; squares cut off 29 % of a circle.
    off = {"pybullet": 0.75, "lp4": 0.3}.get(name, 0.15)
    assert low.robustness == pytest.approx(0.5 * G, rel=off)
    assert high.robustness == pytest.approx(0.5 * G / 0.9, rel=off)
    assert down.robustness == np.inf
    for result in (low, high):
        assert 0 <= result.lower <= result.upper
        assert result.moves == ("cube",)
        assert result.mode in ("slip", "topple", "mixed")


@EVERY_MODEL
def test_forces_that_grow_together_are_answered_or_refused(name, model):
    pair = [Push("cube", (-0.5, y, 0.1), (1, 0, 0)) for y in (-0.2, 0.2)]
    if model.several_forces:
        (found,) = assess(scenes.cube(), [pair], name).results
        assert found.robustness < assess(scenes.cube(), [LOW], name).results[0].robustness
    else:
        with pytest.raises(InputError) as error:
            assess(scenes.cube(), [pair], name)
        assert error.value.code is ErrorCode.BAD_INPUT


@EVERY_MODEL
def test_a_deadline_leaves_bounds_that_hold(name, model):
    analysis = Analysis.of(scenes.table())
    slab = next(item.id for item in analysis.assembly.objects if item.id == "slab")
    push = Push(slab, (1, 0.1, 1.1), (-1, 0, 0))
    found = assess(analysis, [push] * 3, name, deadline=0.0)
    assert not found.complete
    full = assess(analysis, [push], name).results[0]
    assert all(result.lower <= full.upper * (1 + 1e-6) for result in found.results)


@EVERY_MODEL
def test_maps_are_given_or_refused(name, model):
    if model.maps:
        assert robustness_map(scenes.cube(), 50, model=name).complete
    else:
        with pytest.raises(InputError) as error:
            robustness_map(scenes.cube(), 50, model=name)
        assert error.value.code is ErrorCode.BAD_INPUT
