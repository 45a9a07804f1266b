"""Undersides that no view sees, between the edges that views look under."""

import numpy as np

from poise.scanning.underside import underside

CELL, FLOOR = 2e-3, 1e-3
LOW = np.zeros(3)
X, Y = np.meshgrid((np.arange(40) + 0.5) * CELL, (np.arange(20) + 0.5) * CELL, indexing="ij")
EDGE = np.ones(X.shape, bool)
EDGE[1:-1, 1:-1] = False


def found(bottom: np.ndarray, looked_under: np.ndarray) -> np.ndarray:
    """Heights of an underside at heights (X, Y) m, of which views see the edge, and look under some columns."""
    solid = np.ones((*X.shape, 15), bool)
    solid[looked_under] = CELL * (np.arange(15) + 0.5) > bottom[looked_under][:, None]
    walls = [np.stack([X[EDGE], Y[EDGE], np.maximum(bottom[EDGE], FLOOR) + up], axis=1) for up in (0.0, 2e-3, 4e-3)]
    points = np.concatenate(walls)
    return underside(solid, (points, np.tile([1.0, 0.0, 0.0], (len(points), 1))), FLOOR, LOW, CELL)


def test_what_stands_has_no_air_below() -> None:
    np.testing.assert_array_equal(found(np.zeros(X.shape), np.zeros(X.shape, bool)), 0.0)


def test_an_arm_over_the_table_keeps_its_air() -> None:
    """It rises from the middle of the object on, and views look under its end, and some way under its sides."""
    bottom = 0.4 * np.maximum(X - 0.045, 0.0)
    air = found(bottom, EDGE & (bottom > 3e-3))
    np.testing.assert_allclose(air[:20], 0.0, atol=1e-3)
    np.testing.assert_allclose(air[30:], bottom[30:], atol=1.5e-3)
    assert np.all(air >= 0)


def test_a_plate_on_a_hidden_foot_comes_down_to_it() -> None:
    """Views look under all of its edges, and it stands on something."""
    air = found(np.full(X.shape, 6e-3), EDGE)
    assert air[EDGE].mean() > 4e-3
    assert air.min() < 1e-3
    assert 1e-3 < air.mean() < 6e-3
    lowest = np.unravel_index(np.argmin(air), air.shape)
    assert abs(lowest[0] - 19.5) < 4
    assert abs(lowest[1] - 9.5) < 4


def test_free_cells_at_the_rim_of_a_plate_on_the_table_are_no_air() -> None:
    """Its outline crosses cells, whose middles are beside it: views look through them, and not under it."""
    solid = np.ones((*X.shape, 3), bool)
    solid[np.arange(0, 40, 9), 0, 0] = solid[np.arange(4, 40, 9), -1, 0] = False
    walls = np.stack([X[EDGE], Y[EDGE], np.full(EDGE.sum(), 3.5e-3)], axis=1)
    air = underside(solid, (walls, np.tile([1.0, 0.0, 0.0], (len(walls), 1))), FLOOR, LOW, CELL)
    np.testing.assert_array_equal(air, 0.0)


def test_a_shelf_between_walls_goes_on_below_its_own_top() -> None:
    """A gusset in a corner: its edge hovers, walls around it stand, and its underside does not come down to them."""
    solid = np.ones((*X.shape, 15), bool)
    shelf = np.zeros(X.shape, bool)
    shelf[:30, 3:-3] = True  # open at x = 0; walls on the other sides
    solid[shelf, 8:] = False
    front = np.zeros(X.shape, bool)
    front[0] = shelf[0]
    solid[:2][shelf[:2], :6] = False  # views look under the front
    edge = np.stack([X[front], Y[front], np.full(front.sum(), 0.012)], axis=1)
    outer = EDGE & ~front
    wall = np.stack([X[outer], Y[outer], np.full(outer.sum(), FLOOR)], axis=1)
    outwards = np.column_stack([X[outer] - X.mean(), Y[outer] - Y.mean(), np.zeros(outer.sum())])
    outwards /= np.linalg.norm(outwards, axis=1)[:, None]
    normals = np.concatenate([np.tile([-1.0, 0.0, 0.0], (len(edge), 1)), outwards])
    air = underside(solid, (np.concatenate([edge, wall]), normals), FLOOR, LOW, CELL)
    np.testing.assert_allclose(air[shelf], 0.012, atol=1.5e-3)
    np.testing.assert_allclose(air[~shelf], 0.0, atol=1e-3)
