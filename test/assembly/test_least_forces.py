"""Least contact forces by Newton steps against a conic solver, on random blocks and loads, and where there are none."""

import assembly_scenes as scenes
import numpy as np
import pytest

from benchmarks.touching import random_scene
from poise.assembly import Analysis
from poise.assembly.statics import equilibrium, least_forces
from poise.assembly.statics.equilibrium import contact_forces
from poise.errors import ErrorCode, NoAnswerError


def random_loads():
    """Blocks with gravity, and with other loads on some of their bodies; many of these nothing balances."""
    for number in range(5):
        for kind in ("row", "wall", "pallet"):
            rng = np.random.default_rng([21, number])
            for block in Analysis.of(random_scene(kind, rng)).blocks:
                load = block.geometry.gravity.ravel()
                for size in (0.0, 0.1, 3.0):
                    more = size * np.abs(load).max() * rng.normal(size=len(load)) * (rng.random(len(load)) < 0.3)
                    yield block.geometry, load + more


def by_clarabel(geometry, load, monkeypatch):
    with monkeypatch.context() as only:
        only.setattr(equilibrium, "least_forces", lambda *_: None)
        try:
            return contact_forces(geometry, load)
        except NoAnswerError:
            return None


def test_forces_are_those_of_the_conic_solver_and_there_are_none_where_it_finds_none(monkeypatch):
    found = none = 0
    for geometry, load in random_loads():
        direct, forces = by_clarabel(geometry, load, monkeypatch), least_forces.least_forces(geometry, load)
        assert (direct is None) == (forces is None)
        if forces is None or direct is None:
            none += 1
            continue
        found += 1
        np.testing.assert_allclose(forces, direct, atol=2e-5 * max(1.0, float(np.abs(direct).max())))
        assert (forces**2).sum() <= (direct**2).sum() * (1 + 1e-9)
        np.testing.assert_allclose(geometry.grasp @ forces.ravel(), -load, atol=1e-8)
        slides = np.linalg.norm(forces[:, 1:], axis=1)
        assert np.all(slides <= geometry.friction * forces[:, 0] * (1 + 1e-12) + 1e-15)
    assert min(found, none) >= 5


def test_without_friction_forces_are_normal():
    geometry = Analysis.of(scenes.cube(0.0)).blocks[0].geometry
    np.testing.assert_allclose(least_forces.least_forces(geometry, geometry.gravity.ravel())[:, 0], 0.25, atol=1e-12)
    sideways = geometry.gravity.ravel() + np.array([1e-3, 0, 0, 0, 0, 0])
    assert least_forces.least_forces(geometry, sideways) is None
    with pytest.raises(NoAnswerError) as raised:
        contact_forces(geometry, sideways)
    assert raised.value.code is ErrorCode.UNSTABLE


def test_where_steps_do_not_end_the_conic_solver_answers(monkeypatch):
    geometry = Analysis.of(scenes.table()).blocks[0].geometry
    quick = contact_forces(geometry)
    monkeypatch.setattr(least_forces, "_STEPS", 1)
    monkeypatch.setattr(least_forces, "_ACCEPTED", 0.0)
    assert least_forces.least_forces(geometry, geometry.gravity.ravel()) is None
    np.testing.assert_allclose(contact_forces(geometry), quick, atol=1e-6)


def test_loads_that_are_not_finite_are_refused():
    geometry = Analysis.of(scenes.cube()).blocks[0].geometry
    with pytest.raises(NoAnswerError) as raised:
        contact_forces(geometry, np.full(6, np.nan))
    assert raised.value.code is ErrorCode.SOLVER_FAILED
