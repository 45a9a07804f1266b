"""Deformations of `benchmarks/deformations.py`, against bodies that were deformed by known amounts."""

import numpy as np

from benchmarks.deformations import coordinates
from poise.inertia.bayes.mass_model import N_DEFORMATIONS, MassModel


def test_coordinates_are_those_that_a_body_was_deformed_with() -> None:
    rng = np.random.default_rng(0)
    body = MassModel.of_blob(np.zeros(3), 1.0)
    exact = MassModel(body.unit_moments, body.shares, body.to_sensor, body.radii)  # no halvings
    states = np.column_stack([np.zeros(20), 0.01 * rng.normal(size=(20, N_DEFORMATIONS))])
    phis, _ = exact.evaluate(states)
    found = np.array([coordinates(phi / phi[0]) for phi in phis])
    np.testing.assert_allclose(found, states[:, 1:], atol=4e-4)
