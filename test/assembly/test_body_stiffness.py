"""The stiffness between bodies: each way to store it gives the same displacements, and its entries are derivatives."""

import assembly_scenes as scenes
import numpy as np
import pytest

from poise.assembly import Analysis
from poise.assembly.statics.body_stiffness import BodyStiffness


@pytest.mark.parametrize(("count", "band", "kind"), [(12, 72, "dense"), (40, 72, "band"), (40, 5, "sparse")])
def test_dense_banded_and_sparse_solve_the_same_system(count, band, kind):
    """Against the matrix that is added up pair by pair; bodies in a random order, some on the ground."""
    rng = np.random.default_rng(count)
    order = rng.permutation(count)
    sides = np.array([(order[i], order[i + 1]) for i in range(count - 1)] + [(count, order[0]), (count, order[-1])])
    roots = rng.standard_normal((len(sides), 6, 6))
    pairs = roots @ roots.transpose(0, 2, 1) + rng.standard_normal((len(sides), 6, 6)) / 10  # not symmetric
    whole = np.zeros((6 * (count + 1), 6 * (count + 1)))
    for (first, second), block in zip(6 * sides, pairs, strict=True):
        for row, column, sign in ((first, first, 1), (second, second, 1), (first, second, -1), (second, first, -1)):
            whole[row : row + 6, column : column + 6] += sign * block
    matrix = whole[:-6, :-6] + 0.1 * np.eye(6 * count)
    load = rng.standard_normal(6 * count)
    bodies = BodyStiffness(sides, count, band)
    assert bodies.kind == kind
    np.testing.assert_allclose(bodies.solve(bodies.matrix(pairs, 0.1), load), np.linalg.solve(matrix, load), rtol=1e-8)


@pytest.mark.parametrize("bounded", [True, False])
def test_the_jacobian_is_the_derivative_of_what_is_left(bounded):
    """By central differences, at a state in which some contacts are open, some stick and some slip."""
    block = Analysis.of(scenes.wall(3, 3)).blocks[0]
    contacts, gravity = block.solvers.coulomb.contacts, block.geometry.gravity.ravel()
    rng = np.random.default_rng(1)
    u = block.solvers.coulomb.rest.displacement + 0.3 * rng.standard_normal(len(gravity))
    relative = contacts.relative(u)
    bounds = contacts.pressed(relative) * rng.uniform(0.5, 1.5, len(relative)) if bounded else None
    stiffness = contacts.jacobian(relative, bounds, damping=0.5)
    step = rng.standard_normal(len(u))

    acts = (relative[:, 0] <= 0) | (bounded & (contacts.pressed(relative) > 0))
    couples = (np.bincount(contacts.interface, acts) > 0) | np.any(contacts.sides == contacts.count, axis=1)
    damped = couples[contacts.interface]  # the others are left out

    def slope(pressed, limits):
        ends = [u + distance * step for distance in (1e-6, -1e-6)]
        above, below = (contacts.left(end, gravity, contacts.relative(end) - pressed, limits) for end in ends)
        return (above - below) / 2e-6

    # The damping is a share of the stiffness when all contacts are pressed and stick.
    pressed = np.outer(np.where(damped, 1e3, 0.0), [1.0, 0.0, 0.0])
    stuck = slope(pressed, np.where(damped, np.inf, 0.0)) - contacts.catch * step
    np.testing.assert_allclose(stiffness.solve(slope(0.0, bounds) + 0.5 * stuck), step, atol=1e-5)
    assert (relative[:, 0] < 0).sum() > 5
    assert (relative[:, 0] > 0).sum() > 5
