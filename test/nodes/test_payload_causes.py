"""The search for causes behind `identify_payload`: it always ends, and answers the estimate that it was asked about."""

import time
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("rclpy")

from poise.errors import ErrorCode
from poise.inertia import identify
from poise.nodes import payload_causes
from poise.nodes.payload_causes import CauseSearch, CheckedAnswer
from poise.recording import open_recording

pytestmark = pytest.mark.ros
BAG = Path(__file__).resolve().parents[2] / "bags" / "kuka_static_poses.mcap"


@pytest.fixture(scope="module")
def estimate():
    return identify(open_recording(BAG), keep_history=False).estimate


def answer_of(search, estimate):
    end = time.monotonic() + 30.0
    while not search.done(estimate):
        assert time.monotonic() < end, "the search does not end"
        time.sleep(0.005)
    return search.take()


def test_a_search_that_fails_withholds_the_estimate_and_does_not_block_the_next(estimate, monkeypatch):
    def fail(estimate):
        raise ZeroDivisionError("a bug")

    search = CauseSearch()
    with monkeypatch.context() as patch:
        patch.setattr(payload_causes, "checked", fail)
        failed = answer_of(search, estimate)
    assert failed.error is not None
    assert failed.error.code is ErrorCode.INTERNAL
    assert np.isnan(failed.message.inertia.m)
    assert answer_of(search, estimate).error is None


def test_a_search_of_an_abandoned_goal_does_not_answer_the_next(estimate, monkeypatch):
    other = replace(estimate)
    monkeypatch.setattr(payload_causes, "checked", lambda estimate: CheckedAnswer(estimate, None))
    search = CauseSearch()
    search.done(other)
    assert answer_of(search, estimate).estimate is estimate
