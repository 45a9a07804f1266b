"""Paths of a growing load, on a spring of one degree of freedom."""

import numpy as np
import pytest

from poise.assembly.statics.load_path import PathPoint, follow

ONE = np.ones(1)


def spring(limit=np.inf, fails_at=()):
    """Equilibria of a spring that yields at a load; some of the questions have no answer."""
    asked = []

    def reach(start, _):
        asked.append(float(start[0]))
        if len(asked) in fails_at:
            return None
        way = float(start[0])
        return PathPoint(start, min(way, limit), True, 1.0 if way < limit else 1e12, 3)

    return reach, asked


def test_a_path_ends_where_the_spring_yields():
    reach, _ = spring(limit=7.0)
    found = follow(reach, np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004)
    assert found.ended
    assert found.best.factor == pytest.approx(7.0)


def test_steps_grow_again_after_one_that_failed_however_long_the_way():
    reach, asked = spring(fails_at=(2,))
    found = follow(reach, np.zeros(1), ONE, ONE, 1e9, 1.0, 0.004)
    assert found.best.factor >= 1e9
    assert len(asked) < 25


def test_a_path_may_begin_at_an_equilibrium():
    reach, asked = spring(limit=7.0)
    begin = PathPoint(6.0 * ONE, 6.0, True, 1.0, 3)
    found = follow(reach, np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004, begin)
    assert min(asked) > 6.0
    assert found.best.factor == pytest.approx(7.0)
    enough = follow(reach, np.zeros(1), ONE, ONE, 5.0, 1.0, 0.004, begin)
    assert enough.ended
    assert enough.best.factor == 6.0


def test_an_earlier_equilibrium_is_the_last_one_up_to_a_factor():
    reach, _ = spring(limit=7.0)
    found = follow(reach, np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004)
    earlier = found.up_to(0.8 * found.best.factor)
    assert 0 < earlier.factor <= 0.8 * 7.0
    assert found.up_to(-1.0) is found.points[0]
