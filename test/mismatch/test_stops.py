"""A part between two stops, with and without dry friction, against closed forms and independent integration."""

import numpy as np
import pytest

from poise.mismatch.effects import stops
from poise.mismatch.effects.knocks import find_knocks
from poise.mismatch.effects.stops import between_stops, travelled

GRAVITY = 9.80665


def test_a_part_falls_freely_and_rebounds_with_the_share_of_a_damped_stop():
    """A push that jumps from one sign to the other: fall time sqrt(2 gap / g), speed sqrt(2 g gap), rebound e^-2."""
    seconds, gap, settling = np.arange(0.0, 2.0, 1e-4), 0.02, 0.002
    push = np.where(seconds < 1.0, -GRAVITY, GRAVITY)
    x, dx, ddx = between_stops(seconds, push, gap, settling)
    rest, depth = seconds < 0.9998, GRAVITY * settling**2
    np.testing.assert_allclose(x[rest], -gap / 2 - depth, rtol=1e-9)
    fall, speed = np.sqrt(2 * gap / GRAVITY), np.sqrt(2 * GRAVITY * gap)
    flying = (seconds > 1.01) & (seconds < 1.0 + fall - 2e-3)
    np.testing.assert_allclose(x[flying], -gap / 2 + 0.5 * GRAVITY * (seconds[flying] - 1.0) ** 2, atol=2.5e-4)
    assert dx.max() == pytest.approx(speed, rel=0.01)
    # The stop changes the momentum by 1 + e^-2; the push is small beside it.
    knock = (seconds > 1.0 + fall - 2e-3) & (seconds < 1.0 + fall + 3 * settling)
    assert dx[knock].min() == pytest.approx(-np.exp(-2.0) * speed, abs=0.02 * speed)
    assert x[-1] == pytest.approx(gap / 2 + depth)
    assert ddx[-1] == pytest.approx(0.0, abs=1e-6)


@pytest.mark.parametrize("compiled", [True, False])
def test_dry_friction_holds_a_part_and_slows_it(compiled, monkeypatch):
    """It starts when the push exceeds the drag, slides under their difference, and stops where its speed vanishes."""
    monkeypatch.setattr(stops, "COMPILED", compiled and stops.COMPILED)
    seconds, settling = np.arange(0.0, 6.0, 1e-3), 0.002
    push = np.interp(seconds, [0.0, 1.0, 3.0], [-2.0, -2.0, 2.0])  # it reaches the drag of 1 m/s2 at 2.5 s
    x, dx, _ = between_stops(seconds, push, 10.0, settling, np.ones_like(seconds))
    np.testing.assert_allclose(x[seconds <= 2.5], -5.0, atol=1e-5)  # 8 um of the stop give way
    sliding = (seconds > 2.6) & (seconds < 3.0)
    np.testing.assert_allclose(dx[sliding], (seconds[sliding] - 2.5) ** 2, atol=2e-3)
    # Without a push it runs out: v^2 / (2 drag).
    push = np.where(seconds < 1.0, 0.5, np.where(seconds < 2.0, -3.0, 0.0))
    x, dx, _ = between_stops(seconds, push, 10.0, settling, np.ones_like(seconds))
    at = int(np.searchsorted(seconds, 2.0))
    assert dx[at] == pytest.approx(-2.0, abs=0.01)
    assert x[-1] - x[at] == pytest.approx(-(dx[at] ** 2) / 2, rel=0.01)
    assert np.all(dx[seconds > 4.1] == 0.0)


@pytest.mark.parametrize("settling", [0.003, 0.012])
@pytest.mark.parametrize("friction", [0.0, 0.05, 0.4])
def test_a_part_moves_as_an_independent_integration_says(settling, friction):
    """Semi-implicit steps of 10 us, in which dry friction takes what it can of the speed."""
    fine, step, gap = np.arange(0.0, 6.0, 1e-5), 1e-5, 0.02
    push = 4.0 * np.sin(1.3 * fine + 0.4) + 1.5 * np.cos(5.9 * fine)
    drag = friction * (4.0 + np.cos(2.0 * fine))
    x, v = np.sign(push[0]) * (gap / 2 + abs(push[0]) * settling**2), 0.0
    wanted = np.empty((len(fine), 2))
    for i, (p, f) in enumerate(zip(push.tolist(), drag.tolist(), strict=True)):
        wanted[i] = x, v
        side = 1.0 if x > 0.0 else -1.0
        depth = side * x - gap / 2
        stop = max(depth / settling**2 + 2.0 * side * v / settling, 0.0) if depth > 0.0 else 0.0
        free = v + step * (p - side * stop)
        v = max(free - step * f, 0.0) if free > 0.0 else min(free + step * f, 0.0)
        x += step * v
    x, dx, _ = between_stops(fine[::500], push[::500], gap, settling, drag[::500])
    assert np.ptp(x) > gap
    np.testing.assert_allclose(x, wanted[::500, 0], atol=0.01 * gap)
    assert np.mean(np.abs(dx - wanted[::500, 1]) < 0.02 * np.abs(wanted[:, 1]).max()) > 0.99


def test_position_speed_and_acceleration_of_a_part_belong_together():
    seconds = np.arange(0.0, 6.0, 2e-4)
    push = 6.0 * np.sin(2.1 * seconds + 0.3)
    x, dx, ddx = between_stops(seconds, push, 0.03, 0.01)
    np.testing.assert_allclose(x[0] + np.concatenate([[0.0], np.cumsum((dx[1:] + dx[:-1]) / 2) * 2e-4]), x, atol=2e-5)
    speed = np.concatenate([[0.0], np.cumsum((ddx[1:] + ddx[:-1]) / 2) * 2e-4])
    np.testing.assert_allclose(speed, dx, atol=0.02)


def test_a_push_that_never_turns_never_moves_the_part():
    seconds = np.arange(0.0, 5.0, 0.01)
    push, settling = 1.0 + 0.5 * np.sin(seconds), 0.005
    x, dx, _ = between_stops(seconds, push, 0.01, settling)
    np.testing.assert_allclose(x, 0.005 + push * settling**2, atol=1e-6)
    np.testing.assert_allclose(dx, 0.0, atol=1e-4)


def test_many_turns_of_the_push_end_in_time():
    """Noise about zero, and a stop so stiff that its steps are limited."""
    seconds = np.arange(0.0, 60.0, 0.01)
    push = np.random.default_rng(1).normal(size=len(seconds))
    for settling in (0.005, 1e-9):
        for drag in (None, np.abs(push[::-1]), np.full_like(push, 1e-12)):
            assert np.isfinite(between_stops(seconds, push, 0.02, settling, drag)).all()


def test_knocks_are_found_with_their_moments_impulses_and_settling():
    seconds = np.arange(0.003, 20.0, 0.01)  # a lost sample would hide a knock
    push = 5.0 * np.sin(0.9 * seconds)
    gap, mass, settling = 0.02, 0.35, 0.008
    axis = np.array([0.6, 0.0, 0.8])
    x, _, ddx = between_stops(seconds, push, gap, settling)
    noise = np.random.default_rng(2).normal(size=(len(seconds), 3)) * 0.1
    (best, *_) = find_knocks(seconds, -mass * ddx[:, None] * axis + noise, np.full(3, 0.1))
    assert abs(best.axis @ axis) > 0.999
    assert best.settling == pytest.approx(settling, rel=0.3)
    impulses = best.impulses * np.sign(best.axis @ axis)
    far, speed = travelled(seconds, push, best.moments, np.sign(impulses))
    assert len(best.moments) == np.count_nonzero(np.diff(np.sign(x))) >= 4
    np.testing.assert_allclose(np.abs(far[1]), gap, rtol=0.08)
    np.testing.assert_allclose(impulses, mass * speed[1], rtol=0.3)


def test_a_force_without_jumps_has_no_knocks():
    seconds = np.arange(0.0, 20.0, 0.01)
    noise = np.random.default_rng(2).normal(size=(2000, 3)) * 0.1
    assert find_knocks(seconds, np.sin(seconds)[:, None] + noise, np.full(3, 0.1)) == []


@pytest.mark.parametrize("compiled", [True, False])
def test_a_part_that_is_not_pushed_rests_at_its_stop(compiled, monkeypatch):
    """Rounding once began a new contact after each: a minute of CPU for two seconds of a gantry at rest."""
    monkeypatch.setattr(stops, "COMPILED", compiled and stops.COMPILED)
    rng = np.random.default_rng(3)
    push = -1.4e-16 + np.cumsum(rng.choice([-1, 0, 1], 900)) * 4.57e-18 * 3
    push[rng.random(900) < 0.05] = 0.0
    x, dx, ddx = between_stops(np.arange(900) * 0.004, push, 3e-5, 0.006)
    np.testing.assert_allclose(x, -1.5e-5, atol=1e-13)
    np.testing.assert_allclose([dx, ddx], 0.0, atol=1e-9)
