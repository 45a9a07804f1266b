"""Errors are values: they reach another process whole."""

import copy

from poise.errors import ErrorCode, NoAnswerError


def test_an_error_keeps_its_code_words_and_data_in_another_process():
    error = NoAnswerError(ErrorCode.UNSTABLE, "b falls", objects=["b"], margin=-1.0)
    there = copy.deepcopy(error)  # by the protocol of pickle and multiprocessing
    assert type(there) is NoAnswerError
    assert (there.code, there.message, there.data) == (error.code, "b falls", {"objects": ["b"], "margin": -1.0})
    assert there.exit_status == 3
