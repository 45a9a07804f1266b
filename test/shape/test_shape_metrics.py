"""The scores of segmentations and surfaces, against cases counted by hand."""

import numpy as np
import pytest

from poise.shape.metrics import global_consistency_error, scaled_distances, scaled_hausdorff, undersegmentation_error

TRUTH = [0] * 6 + [1] * 4


def test_the_truth_has_no_error_whatever_its_names() -> None:
    assert undersegmentation_error([7] * 6 + [3] * 4, TRUTH) == 0
    assert global_consistency_error([7] * 6 + [3] * 4, TRUTH) == 0


def test_finer_cuts_inside_the_parts_are_no_error() -> None:
    finer = [0, 0, 1, 1, 2, 2, 3, 3, 4, 4]
    assert undersegmentation_error(finer, TRUTH) == 0
    assert global_consistency_error(finer, TRUTH) == 0


def test_one_segment_over_two_parts_bleeds_the_smaller_share_on_both_sides() -> None:
    # Part 0 has 6 inside and 4 outside, part 1 has 4 inside and 6 outside: min is 4 twice.
    assert undersegmentation_error([0] * 10, TRUTH) == pytest.approx(0.8)
    # A refinement is consistent for GCE.
    assert global_consistency_error([0] * 10, TRUTH) == 0


def test_a_border_off_by_one_point() -> None:
    shifted = [0] * 5 + [1] * 5
    assert undersegmentation_error(shifted, TRUTH) == pytest.approx(0.2)
    # Truth into segments: 1 point in part 0 has 5/6 elsewhere, 5 have 1/6: 10/6. Segments into truth: 8/5.
    assert global_consistency_error(shifted, TRUTH) == pytest.approx(min(10 / 6, 8 / 5) / 10)


def test_hausdorff_is_the_longest_way_to_the_other_set_in_diagonals() -> None:
    reference = np.array([[0.0, 0, 0], [3, 4, 0]])  # diagonal 5
    assert scaled_hausdorff(reference, reference) == 0
    assert scaled_hausdorff(np.array([[0.0, 0, 1], [3, 4, 0]]), reference) == pytest.approx(0.2)
    assert scaled_hausdorff(reference[:1], reference) == pytest.approx(1.0)
    # There 1 and 0, back 1 and 0: half on average; to one point there 0, back 0 and 5.
    assert scaled_distances(np.array([[0.0, 0, 1], [3, 4, 0]]), reference)[1] == pytest.approx(0.1)
    assert scaled_distances(reference[:1], reference)[1] == pytest.approx(0.25)
