"""Paths of a growing load, on a spring of one degree of freedom."""

import numpy as np
import pytest

from poise.assembly.statics.load_path import LoadPath, PathPoint, follow, go_on, look_beyond
from poise.assembly.statics.newton_goal import Goal

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


def stands_to(limit, known_to=np.inf):
    """Whether a block stands under a given factor, up to the one to which that is known."""

    def stand(factor, start, _):
        return PathPoint(factor * ONE, factor, factor <= limit) if factor <= known_to else None

    return stand


def no_further(begin):
    return LoadPath([PathPoint(0 * ONE, 0.0), begin], begin.displacement, False)


EARLY = LoadPath([PathPoint(0 * ONE, 0.0), PathPoint(ONE, 1.0)], ONE, False)


def test_where_no_next_equilibrium_is_found_given_factors_decide():
    found = go_on(EARLY, stands_to(1.7), no_further, 1e6, 0.004)
    assert found.ended
    assert 1.7 / 1.008 <= found.best.factor <= 1.7
    enough = go_on(EARLY, stands_to(1.7), no_further, 1.2, 0.004)
    assert enough.ended
    assert enough.best.factor == 1.2


def test_a_path_goes_on_where_it_can_be_followed_again():
    def resume(begin):
        return LoadPath([PathPoint(0 * ONE, 0.0), begin, PathPoint(3 * ONE, 3.0)], 3 * ONE, True)

    found = go_on(EARLY, stands_to(1.7), resume, 1e6, 0.004)
    assert found.ended
    assert found.best.factor == 3.0


def test_a_path_beyond_which_nothing_is_known_has_not_ended():
    found = go_on(EARLY, stands_to(1.7, known_to=1.3), no_further, 1e6, 0.004)
    assert not found.ended
    assert 1.3 / 1.008 <= found.best.factor <= 1.3


def test_a_point_where_the_load_yields_for_a_moment_is_no_collapse():
    def reach(start, _):
        way = float(start[0])  # 0.25 and 0.75 first, where it yields
        return PathPoint(start, min(way, 7.0), True, 1e12 if way < 1 or way > 7 else 1.0, 3)

    found = follow(reach, np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004)
    assert found.ended
    assert found.best.factor == pytest.approx(7.0)


def test_a_fall_at_far_more_than_the_last_point_is_no_end():
    def reach(start, _):
        way = float(start[0])
        return PathPoint(start, way, way < 5.0, 1.0, 3)

    assert not follow(reach, np.zeros(1), ONE, ONE, 16.0, 1.0, 0.004).ended


def test_a_path_that_runs_out_of_steps_has_not_ended():
    def reach(start, steps):
        way = float(start[0])
        return PathPoint(start, way**0.5, True, 1.0, steps)

    assert not follow(reach, np.zeros(1), ONE, ONE, 1e30, 1.0, 1e-9).ended


def peaked(peak, fall):
    """A spring whose load grows up to a peak, then drops by a share and falls slowly."""

    def reach(start, _):
        way = float(start[0])
        if way <= peak:
            return PathPoint(start, way, True, 1.0, 3)
        return PathPoint(start, peak * (1 - fall) - 0.01 * (way - peak), True, -100.0, 3)

    return reach


@pytest.mark.parametrize("fall", [0.0, 0.03, 0.2])
@pytest.mark.parametrize("peak", [1.3, 5.0, 7.7])
def test_a_peak_between_two_points_is_found(peak, fall):
    found = follow(peaked(peak, fall), np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004)
    assert found.ended
    assert peak / 1.016 <= found.best.factor <= peak
    begun = PathPoint(ONE, 1.0, True, 1.0, 3)
    again = follow(peaked(peak, fall), np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004, begun)
    assert peak / 1.016 <= again.best.factor <= peak


def test_a_peak_before_a_plateau_is_found():
    def reach(start, _):
        way = float(start[0])
        return PathPoint(start, way if way <= 2.0 else 1.9, True, 1.0 if way <= 2.0 else 1e3, 3)

    found = follow(reach, np.zeros(1), ONE, ONE, 1e6, 1.0, 0.004)
    assert found.ended
    assert found.best.factor == pytest.approx(2.0, rel=0.016)


def test_no_point_is_sought_beyond_what_is_asked():
    found = follow(peaked(5.0, 0.0), np.zeros(1), ONE, ONE, 4.0, 1.0, 0.004)
    assert found.ended
    assert 4.0 <= found.best.factor <= 5.0


def test_beyond_the_end_of_a_path_a_state_is_looked_for_near_it():
    points = [PathPoint(way * ONE, factor) for way, factor in ((0.0, 0.0), (1.0, 1.0), (2.0, 1.5), (4.0, 1.4))]
    path, asked = LoadPath(points, 5.0 * ONE, True), []

    def look(factor, start):
        asked.append(float(start[0]))
        return PathPoint(start, factor) if len(asked) == 3 else None

    found = look_beyond(path, look, 10.0, 0.004)
    assert asked == [3.0, 8.0, 4.0]
    assert not found.ended
    assert found.best.factor == pytest.approx(1.012 * 1.5)
    assert look_beyond(path, look, 10.0, 0.004) is path  # none stands


@pytest.mark.parametrize(("factors", "ended"), [((0.0,), True), ((0.0, 2.0), True), ((0.0, 1.0), False)])
def test_nothing_is_looked_for_from_rest_nor_beyond_what_is_asked_nor_on_the_way(factors, ended):
    path = LoadPath([PathPoint(ONE, factor) for factor in factors], ONE, ended)
    assert look_beyond(path, lambda factor, start: PathPoint(start, factor), 2.0, 0.004) is path


class Kink:
    """Steps of more than a sixteenth leave more than before, as where springs open and close again."""

    def moved(self, move):
        return move

    def left(self, u, load, relative, bounds=None):
        return np.array([0.99 if 0 < u[0] <= 1 / 16 else 1.0 + 20 * u[0]])


def test_near_an_equilibrium_few_whole_steps_leave_more_than_before():
    goal, zero = Goal(np.zeros(1)), np.zeros(1)
    found = [goal.search(Kink(), zero, zero, ONE, 1.0, enough=1e-4) for _ in range(4)]
    assert found == [*[(1.0, 21.0, True)] * 3, (1 / 16, 0.99, False)]
    assert not Goal(np.zeros(1)).search(Kink(), zero, zero, ONE, 1.0, enough=1e-6)[2]  # far from one, none does
