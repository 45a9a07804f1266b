"""Block averages: exact, at the centre of their time, the same however the samples were read."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from poise.force_torque.decimation import BlockAverager, BlockAverages, Stamped, block_size

PERIOD = 142_857
EPOCH = 1_790_000_000_000_000_000


def ramp(position: np.ndarray) -> Stamped:
    """SensorSamples whose fx is their place."""
    wrench = np.zeros((len(position), 6))
    wrench[:, 0] = position
    flags = np.zeros(len(position), dtype=bool)
    return Stamped(position, EPOCH + position * PERIOD, wrench, flags, flags.copy())


def push_all(averager: BlockAverager, samples: Stamped, cuts: list[int]) -> list[BlockAverages]:
    edges = [0, *sorted(cut % (len(samples) + 1) for cut in cuts), len(samples)]
    return [averager.push(samples[begin:end]) for begin, end in pairwise(edges)]


def joined(blocks: list[BlockAverages], name: str) -> np.ndarray:
    return np.concatenate([getattr(block, name) for block in blocks])


PLACES = st.sets(st.integers(0, 120), max_size=100).map(lambda places: np.array(sorted(places), dtype=np.int64))


@given(PLACES, st.integers(1, 9), st.lists(st.integers(0, 1000), max_size=8))
def test_blocks_do_not_depend_on_how_the_samples_were_read(places: np.ndarray, size: int, cuts: list[int]) -> None:
    pieces = push_all(BlockAverager(size), ramp(places), cuts)
    whole = BlockAverager(size).push(ramp(places))
    for name in ("stamps", "wrench_in_sensor", "count", "saturated", "faulty"):
        np.testing.assert_array_equal(joined(pieces, name), getattr(whole, name))


@given(PLACES, st.integers(1, 9))
def test_a_ramp_is_on_the_ramp_at_the_stamp_even_where_samples_were_lost(places: np.ndarray, size: int) -> None:
    blocks = BlockAverager(size).push(ramp(places))
    np.testing.assert_allclose((blocks.stamps - EPOCH) / PERIOD, blocks.wrench_in_sensor[:, 0], atol=1e-5)


@given(PLACES, st.integers(1, 9))
def test_every_sample_is_in_one_block_of_its_number(places: np.ndarray, size: int) -> None:
    blocks = BlockAverager(size).push(ramp(places))
    numbers, counts = np.unique(places // size, return_counts=True)
    whole = len(numbers) if len(places) and (places[-1] + 1) % size == 0 else max(0, len(numbers) - 1)
    assert blocks.count.tolist() == counts[:whole].tolist()
    np.testing.assert_array_equal(np.floor(blocks.wrench_in_sensor[:, 0] / size), numbers[:whole])


def test_a_flag_of_one_sample_is_a_flag_of_its_block_alone() -> None:
    samples = ramp(np.arange(12))
    samples.saturated[5] = True
    samples.faulty[8] = True
    blocks = BlockAverager(4).push(samples)
    assert blocks.saturated.tolist() == [False, True, False]
    assert blocks.faulty.tolist() == [False, False, True]


@pytest.mark.parametrize("frequency", [5.0, 50.0, 300.0])
def test_a_sine_comes_out_in_phase_with_the_gain_of_a_moving_average(frequency: float) -> None:
    size, rate = 7, 7000.0
    position = np.arange(size * 2000)
    time = position / rate
    wrench = np.zeros((len(position), 6))
    wrench[:, 0] = np.sin(2 * np.pi * frequency * time)
    flags = np.zeros(len(position), dtype=bool)
    stamps = np.rint(time * 1e9).astype(np.int64)
    blocks = BlockAverager(size).push(Stamped(position, stamps, wrench, flags, flags))
    # Mean of `size` samples of a sine: Dirichlet's kernel, no phase about the centre.
    half = np.pi * frequency / rate
    gain = np.sin(size * half) / (size * np.sin(half))
    expected = gain * np.sin(2 * np.pi * frequency * blocks.stamps * 1e-9)
    np.testing.assert_allclose(blocks.wrench_in_sensor[:, 0], expected, atol=2e-6)


def test_half_a_block_can_be_dropped() -> None:
    averager = BlockAverager(4)
    averager.push(ramp(np.arange(6)))
    averager.clear()
    assert averager.push(ramp(np.arange(8, 12))).wrench_in_sensor[:, 0].tolist() == [9.5]


@pytest.mark.parametrize(
    ("sample_rate", "publish_rate", "size"),
    [(7000, 1000, 7), (7000, 500, 14), (7000, 3000, 3), (100, 1000, 1), (7000, 7000, 1), (1000, 999.9999999, 1)],
)
def test_blocks_come_no_faster_than_asked(sample_rate: float, publish_rate: float, size: int) -> None:
    assert block_size(sample_rate, publish_rate) == size
