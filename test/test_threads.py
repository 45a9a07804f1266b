"""One thread of OpenBLAS within questions about assemblies, and as many as before after them."""

import json
import os
import subprocess
import sys
from pathlib import Path

import pytest

from poise.assembly import acceleration_limits, assess, plan_disassembly, robustness_map, settle
from poise.placement import plan_placement

ROOT = Path(__file__).resolve().parents[1]

CODE = """if True:
    import json, threading
    import numpy, scipy.linalg
    from poise.threads import _libraries, in_one_thread, one_thread

    counts = lambda: [library.threads() for library in _libraries()]
    for library in _libraries():
        library.set_threads(2)
    before, entered, leave = counts(), threading.Event(), threading.Event()

    @in_one_thread
    def asked(fail):
        seen.append(counts())
        with one_thread():  # a question within a question
            pass
        seen.append(counts())
        if fail:
            raise ValueError

    seen = []
    asked(False)
    try:
        asked(True)
    except ValueError:
        seen.append(counts())

    def other():
        with one_thread():
            entered.set()
            leave.wait(10)

    thread = threading.Thread(target=other)
    with one_thread():  # ends while the other thread still computes
        thread.start()
        entered.wait(10)
    seen.append(counts())
    leave.set()
    thread.join()
    print(json.dumps([before, seen, counts()]))
"""


def _run(**variables: str) -> tuple[list[int], list[list[int]], list[int]]:
    """Threads of each library before, at six moments, and after."""
    clean = {name: value for name, value in os.environ.items() if name != "OPENBLAS_NUM_THREADS"}
    environment = clean | {"PYTHONPATH": str(ROOT)} | variables
    done = subprocess.run([sys.executable, "-c", CODE], env=environment, capture_output=True, text=True, check=True)
    before, seen, after = json.loads(done.stdout)
    return before, seen, after


@pytest.mark.skipif(sys.platform != "linux", reason="loaded libraries are listed on Linux")
def test_one_thread_inside_and_as_many_as_before_outside():
    before, seen, after = _run()
    one, two = [1] * len(before), [2] * len(before)
    assert before == two != []
    assert seen == [one, one, one, one, two, one]  # two questions, the second fails; another thread still computes
    assert after == two


@pytest.mark.skipif(sys.platform != "linux", reason="loaded libraries are listed on Linux")
def test_what_the_user_has_set_stays():
    before, seen, after = _run(OPENBLAS_NUM_THREADS="2")
    assert [*seen, after] == [before] * 7


@pytest.mark.parametrize(
    "question", [settle, assess, acceleration_limits, robustness_map, plan_disassembly, plan_placement]
)
def test_questions_about_assemblies_compute_in_one_thread(question):
    assert question.__wrapped__.__name__ == question.__name__
