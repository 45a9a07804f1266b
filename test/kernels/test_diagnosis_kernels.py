"""The compiled filters, pendulum and bounded least squares of a diagnosis against their forms in Python."""

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline

from poise.errors import InputError
from poise.kernels import between_stops, bounded_minimum, likely_colours, pendulum
from poise.mismatch.effects import part_motion, stops
from poise.mismatch.inference import box, noise
from poise.mismatch.inference.noise import NoiseColour, SignalNoise
from poise.mismatch.recorded import at_times

N = 300


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(1)


@pytest.mark.parametrize("near", [True, False])
def test_the_least_inside_bounds_is_that_of_python(
    near: bool, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    for count in (1, 2, 9, 60):
        columns = rng.normal(size=(count, 2 * count)) * np.logspace(-2, 2, count)[:, None]
        normal, right = columns @ columns.T, columns @ rng.normal(size=2 * count)
        lower, upper = -rng.uniform(0.0, 0.3, count), rng.uniform(0.0, 0.3, count)
        lower[1::4], upper[2::4] = -np.inf, np.inf
        start = rng.uniform(-0.1, 0.1, count) if near else None
        found = []
        for compiled in (True, False):
            monkeypatch.setattr(box, "COMPILED", compiled)
            found.append(box._boxed(normal, right, lower, upper, start))
        np.testing.assert_allclose(found[0], found[1], rtol=1e-7, atol=1e-10)
    with pytest.raises(np.linalg.LinAlgError):
        bounded_minimum(-np.eye(2), np.ones(2), -np.ones(2), np.ones(2), np.zeros(2))
    with pytest.raises(InputError):
        bounded_minimum(np.eye(2), np.ones(3), -np.ones(3), np.ones(3), None)


@pytest.mark.parametrize("signals", [1, 4, 7])
def test_innovations_are_those_of_python(signals: int, rng: np.random.Generator) -> None:
    seconds = np.cumsum(rng.uniform(0.005, 0.02, N))
    colours = (NoiseColour(), NoiseColour(0.3, 0.2, 0.08), NoiseColour(1.0, 0.0, 0.32))
    level = SignalNoise(np.array([0.1, 0.2, 3.0]), colours, seconds, rng.uniform(size=N), np.ones(3), np.ones(3))
    values = rng.normal(size=(N, 3, signals))
    channel, counting = np.arange(signals) % 3, np.ones(N, dtype=bool)
    found = level.compiled(values, counting, None), level.compiled(values[:, 0], counting, None, channel)
    expected = level.whiten(values), level.whiten(values[:, 0], channel)
    for one, other in zip(found, expected, strict=True):
        np.testing.assert_allclose(one, other.reshape(signals, -1), rtol=1e-12, atol=1e-12)
    with pytest.raises(InputError):
        level.compiled(values[:, 0].T, counting, None, channel)  # rows, not columns
    with pytest.raises(InputError):
        level.compiled(values, counting[1:], None)


@pytest.mark.parametrize("moved", [False, True])
@pytest.mark.parametrize("channels", [1, 6])
def test_the_likely_colours_are_those_of_python(moved: bool, channels: int, rng: np.random.Generator) -> None:
    values = rng.normal(size=(N, channels)) + np.cumsum(rng.normal(size=(N, channels)), axis=0) * 0.05
    speed, motion = rng.uniform(size=N), rng.uniform(size=(N, channels)) if moved else None
    colours = rng.uniform(size=30), rng.uniform(size=30), rng.uniform(size=30), np.arange(30) % 4
    decays = np.exp(-rng.uniform(0.005, 0.02, N) / np.array([0.04, 0.08, 0.16, 0.32])[:, None])
    given = values, speed, motion, colours, decays, (np.full(channels, 0.2), np.full(channels, 3.0))
    for one, other in zip(likely_colours(*given), noise._likely_colours(*given), strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-12)
    with pytest.raises(InputError):
        likely_colours(values, speed[1:], *given[2:])
    values[5] = np.nan
    assert (likely_colours(*given)[0] == -1).all()
    assert (noise._likely_colours(*given)[0] == -1).all()


@pytest.mark.parametrize("blocks", [None, 5])
def test_whitened_means_are_those_of_python(blocks: int | None, rng: np.random.Generator) -> None:
    count = N // (blocks or 1)
    seconds = np.cumsum(rng.uniform(0.005, 0.02, count))
    colours = (NoiseColour(), NoiseColour(0.3, 0.2, 0.08), NoiseColour(1.0, 0.0, 0.32))
    level = SignalNoise(np.array([0.1, 0.2, 3.0]), colours, seconds, rng.uniform(size=count), np.ones(3), np.ones(3))
    values, counting = rng.normal(size=(N, 3, 7)), rng.uniform(size=count) < 0.8
    channel, rows = np.arange(7) % 3, None if blocks is None else np.arange(count * blocks).reshape(count, blocks)
    mean = values if rows is None else values[rows].mean(axis=1)
    for given in (values, np.asfortranarray(values), values[:, :, ::-1]):
        expected = level.whiten(mean[:, :, ::-1] if given.strides[2] < 0 else mean)[:, :, counting]
        np.testing.assert_allclose(level.compiled(given, counting, rows), expected.reshape(7, -1), atol=1e-12)
    expected = level.whiten(mean[:, 0], channel)[:, :, counting].reshape(7, -1)
    np.testing.assert_allclose(level.compiled(values[:, 0], counting, rows, channel), expected, atol=1e-12)
    for wrong in (values[:-1], values[:, :2]):
        with pytest.raises(InputError):
            level.compiled(wrong, counting, None)
    with pytest.raises(InputError):
        level.compiled(values[:, 0], counting, rows, channel + 1)


def test_a_pendulum_swings_as_in_python(rng: np.random.Generator) -> None:
    start = np.array([[0.0, 0.0, -1.0], [0.1, 0.0, -0.995]])
    drive, turn = 1e-3 * rng.normal(size=(2, N, 3)) + [0.0, 0.0, -0.01]
    found = pendulum(start, drive, turn, 0.01)
    np.testing.assert_allclose(found, part_motion._shaken(start, drive, turn, 0.01), atol=1e-12)
    with pytest.raises(InputError):
        pendulum(start[:1], drive, turn, 0.01)


@pytest.mark.parametrize("samples", [4, 5, N])
def test_interpolation_is_that_of_scipy(samples: int, rng: np.random.Generator) -> None:
    seconds = np.cumsum(rng.uniform(0.005, 0.02, samples))
    values = rng.normal(size=(samples, 2, 3))
    wanted = rng.uniform(seconds[0] - 0.1, seconds[-1] + 0.1, N)
    expected = make_interp_spline(seconds, values, k=3)(np.clip(wanted, seconds[0], seconds[-1]))
    np.testing.assert_allclose(at_times(seconds, values, wanted), expected, atol=1e-12)


@pytest.mark.parametrize("settling", [6e-4, 0.008, 0.09])
@pytest.mark.parametrize("friction", [0.0, 0.3])
def test_a_part_between_stops_moves_as_in_python(
    settling: float, friction: float, rng: np.random.Generator, monkeypatch: pytest.MonkeyPatch
) -> None:
    seconds = np.cumsum(rng.uniform(5e-4, 0.015, 1500))  # steps shorter and longer than the average of accelerations
    push = 3.0 * np.sin(4.0 * seconds) + rng.normal(0.3, 0.2, len(seconds))
    drag = friction * rng.uniform(1.0, 3.0, len(seconds)) if friction else None
    found = []
    for compiled in (True, False):
        monkeypatch.setattr(stops, "COMPILED", compiled)
        found.append(stops.between_stops(seconds, push, 0.012, settling, drag))
    for one, other in zip(*found, strict=True):
        np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-11 * np.abs(other).max())
    with pytest.raises(InputError):
        between_stops(seconds, push[:-1], 0.012, settling, 1e-3)
