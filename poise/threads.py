"""One thread of OpenBLAS for small matrices: several threads wait for each other longer than they compute."""

import ctypes
import os
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import cache, wraps
from itertools import product
from pathlib import Path
from threading import Lock
from typing import NamedTuple, ParamSpec, TypeVar

_Arguments = ParamSpec("_Arguments")
_Answer = TypeVar("_Answer")
_MAPS = Path("/proc/self/maps")


class _Library(NamedTuple):
    """Functions of one loaded OpenBLAS: numpy and scipy bring one each."""

    threads: Callable[[], int]
    set_threads: Callable[[int], object]


class _Limit:
    """How many calls compute with one thread now, and how many threads each library had before the first of them."""

    def __init__(self) -> None:
        self._lock, self._calls = Lock(), 0
        self._before: list[tuple[_Library, int]] = []

    def begin(self) -> None:
        with self._lock:
            if self._calls == 0:
                self._before = [(library, library.threads()) for library in _libraries()]
                for library, _ in self._before:
                    library.set_threads(1)
            self._calls += 1

    def end(self) -> None:
        with self._lock:
            self._calls -= 1
            if self._calls == 0:
                for library, threads in self._before:
                    library.set_threads(threads)


_LIMIT = _Limit()


@contextmanager
def one_thread() -> Iterator[None]:
    """Compute with one thread of OpenBLAS, and then with as many as before.

    The number is one for the whole process: other threads of it also compute with one until the last of such calls has
    ended. Nothing is changed if the user has set OPENBLAS_NUM_THREADS, or where the system does not list the loaded
    libraries (other systems than Linux).
    """
    if "OPENBLAS_NUM_THREADS" in os.environ:
        yield
        return
    _LIMIT.begin()
    try:
        yield
    finally:
        _LIMIT.end()


def in_one_thread(function: Callable[_Arguments, _Answer]) -> Callable[_Arguments, _Answer]:
    """A function that computes in `one_thread`."""

    @wraps(function)
    def limited(*args: _Arguments.args, **named: _Arguments.kwargs) -> _Answer:
        with one_thread():
            return function(*args, **named)

    return limited


@cache
def _libraries() -> tuple[_Library, ...]:
    """All OpenBLAS libraries that are loaded at the first call."""
    try:
        lines = _MAPS.read_text(encoding="utf-8", errors="replace").splitlines()
    except OSError:
        return ()
    paths = {columns[5].strip() for line in lines if len(columns := line.split(maxsplit=5)) == 6}
    found = (_opened(path) for path in sorted(paths) if "openblas" in path)
    return tuple(library for library in found if library is not None)


def _opened(path: str) -> _Library | None:
    """The functions of a loaded library, by the names that wheels and distributions give them."""
    try:
        library = ctypes.CDLL(path)
    except OSError:  # a mapped file that is no library, or was replaced since
        return None
    for before, after in product(("scipy_", ""), ("64_", "")):
        names = (f"{before}openblas_{what}_num_threads{after}" for what in ("get", "set"))
        threads, set_threads = (getattr(library, name, None) for name in names)
        if threads is not None and set_threads is not None:
            return _Library(threads, set_threads)
    return None
