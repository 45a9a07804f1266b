"""Every number of a wrapping sequence is accounted for, with losses, copies and reordering."""

from itertools import pairwise

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from poise.force_torque.sequence import MAX_GAP, REORDER_WINDOW, SequenceCounter


def account(counter: SequenceCounter, numbers: list[int]) -> tuple[list[int], list[int]]:
    index, position = counter.account(np.array(numbers, dtype=np.uint32))
    return index.tolist(), position.tolist()


@st.composite
def deliveries(draw: st.DrawFn) -> tuple[int, list[list[int]]]:
    """A start number and reads of places in the stream: thinned, doubled, shuffled nearby, cut anywhere."""
    start = draw(st.sampled_from([0, 1, 2**31 - 20, 2**32 - 30, 2**32 - 1]))
    count = draw(st.integers(1, 60))
    copies = draw(st.lists(st.sampled_from([1, 1, 1, 1, 0, 2]), min_size=count, max_size=count))
    delays = draw(st.lists(st.sampled_from([0, 0, 0, 0, 3, 17]), min_size=2 * count, max_size=2 * count))
    arriving = [place for place, times in enumerate(copies) for _ in range(times if place else 1)]
    order = sorted(range(len(arriving)), key=lambda index: (arriving[index] + delays[index] if index else -1, index))
    arriving = [arriving[index] for index in order]
    cuts = sorted(draw(st.lists(st.integers(0, len(arriving)), max_size=6)))
    edges = [0, *cuts, len(arriving)]
    return start, [arriving[begin:end] for begin, end in pairwise(edges)]


@given(deliveries())
def test_received_and_lost_make_up_what_was_sent(delivery: tuple[int, list[list[int]]]) -> None:
    start, reads = delivery
    counter = SequenceCounter()
    arrived = [place for read in reads for place in read]
    used: list[int] = []
    for read in reads:
        index, position = account(counter, [(start + place) % 2**32 for place in read])
        assert [read[i] for i in index] == position  # the first place is 0, and places neither wrap nor close gaps
        used += position
    assert counter.received == len(set(arrived))
    assert counter.duplicates == len(arrived) - len(set(arrived))
    assert counter.received + counter.lost == max(arrived) + 1
    assert counter.restarts == 0
    assert used == sorted(set(used))  # what is used is in order, and nothing twice


@given(deliveries())
def test_late_samples_are_those_that_come_after_a_later_one(delivery: tuple[int, list[list[int]]]) -> None:
    start, reads = delivery
    counter = SequenceCounter()
    newest, late, seen = -1, 0, set()
    for read in reads:
        account(counter, [(start + place) % 2**32 for place in read])
        for place in read:
            late += place < newest and place not in seen
            seen.add(place)
            newest = max(newest, place)
    assert counter.out_of_order == late


def test_a_sample_that_is_late_within_one_read_is_put_in_its_place() -> None:
    counter = SequenceCounter()
    assert account(counter, [10, 12, 11, 13]) == ([0, 2, 1, 3], [0, 1, 2, 3])
    assert (counter.received, counter.lost, counter.out_of_order) == (4, 0, 1)


def test_a_sample_that_is_late_by_a_read_is_counted_but_not_used() -> None:
    counter = SequenceCounter()
    account(counter, [10, 12])
    assert account(counter, [11, 13]) == ([1], [3])
    assert (counter.received, counter.lost, counter.out_of_order) == (4, 0, 1)


def test_a_device_that_was_asked_to_start_again_begins_anew_without_loss() -> None:
    counter = SequenceCounter()
    account(counter, [1, 2, 3])
    counter.expect_restart()
    account(counter, [4])  # still on its way from before
    index, position = account(counter, [1, 2, 3])
    assert (index, position) == ([0, 1, 2], [4, 5, 6])
    assert (counter.restarts, counter.lost, counter.duplicates, counter.received) == (1, 0, 0, 7)


def test_the_first_start_is_no_restart_and_a_copy_of_its_first_sample_neither() -> None:
    counter = SequenceCounter()
    counter.expect_restart()
    assert account(counter, [7, 7, 8]) == ([0, 2], [0, 1])
    assert (counter.restarts, counter.duplicates, counter.received) == (0, 1, 2)


def test_a_device_that_starts_again_by_itself_is_noticed() -> None:
    counter = SequenceCounter()
    account(counter, [5 * REORDER_WINDOW, 5 * REORDER_WINDOW + 1])
    account(counter, [1])
    assert (counter.restarts, counter.lost) == (1, 0)
    account(counter, [2 + MAX_GAP])
    assert (counter.restarts, counter.lost) == (2, 0)


def test_a_long_gap_is_counted_exactly_and_does_not_fill_the_memory() -> None:
    counter = SequenceCounter()
    account(counter, [0])
    account(counter, [MAX_GAP - 1])
    assert counter.lost == MAX_GAP - 2
    assert len(counter._missing) <= REORDER_WINDOW
