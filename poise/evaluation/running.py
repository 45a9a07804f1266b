"""Runs a job over many sources on a pool of workers and keeps each reply; goes on where an earlier run ended."""

from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

from poise.errors import ErrorCode, InputError
from poise.evaluation.build import this_build
from poise.evaluation.journal import Journal
from poise.evaluation.sources import DataSource
from poise.evaluation.workers import Workers, WorkerTask

_PATIENCE = 5.0
"""s between looks at whether a pool without news is still there."""
_AHEAD = 2
"""Tasks in flight for each worker, so that none waits for its next one."""


@dataclass(frozen=True)
class WorkerPool:
    """Where tasks are answered.

    Args:
        executor: takes calls of `answer`.
        answer: from a task to its reply.
        size: tasks that it answers beside each other.
        lost: what to say when it is no longer there; empty while it is.
    """

    executor: Executor
    answer: Callable[[WorkerTask], dict[str, Any]]
    size: int
    lost: Callable[[], str] = lambda: ""


@contextmanager
def local_pool(size: int) -> Iterator[WorkerPool]:
    """Worker processes of this machine, ended on the way out."""
    workers = Workers()
    executor = ThreadPoolExecutor(size)
    try:
        yield WorkerPool(executor, workers.answer, size)
    finally:
        workers.close()
        executor.shutdown(wait=True, cancel_futures=True)


def unanswered(sources: Iterable[DataSource], journal: Journal, retry: bool) -> list[DataSource]:
    """The sources that the journal has no reply about, or that changed since.

    Args:
        sources: all.
        journal: of the results.
        retry: also those whose reply is an error.
    """
    known = {}
    for entry in journal.entries():
        known[entry["name"]] = None if retry and entry["error"] else (entry["size"], entry["modified"])
    return [source for source in sources if known.get(source.name) != (source.size, source.modified)]


def run(
    sources: Iterable[DataSource],
    task_of: Callable[[DataSource], WorkerTask],
    pool: WorkerPool,
    journal: Journal,
    progress: Callable[[int], None] = lambda done: None,
) -> None:
    """Answer every source once and append each reply to the journal as soon as it is there.

    Args:
        sources: to be answered.
        task_of: the task of a source.
        pool: of workers.
        journal: of the results.
        progress: called with the number of replies so far.

    Raises:
        InputError: UNSUPPORTED when a worker runs another version of Poise, FILE_UNWRITABLE on a full disk, BAD_INPUT
            when the pool is lost. What was answered before is kept.
    """
    pending: dict[Future[dict[str, Any]], DataSource] = {}
    done = 0
    for source in sources:
        pending[pool.executor.submit(pool.answer, task_of(source))] = source
        while len(pending) >= _AHEAD * pool.size:
            done += _keep_finished(pending, pool, journal)
            progress(done)
    while pending:
        done += _keep_finished(pending, pool, journal)
        progress(done)


def _keep_finished(pending: dict[Future[dict[str, Any]], DataSource], pool: WorkerPool, journal: Journal) -> int:
    """Wait for a reply, keep all that are there, and return their number."""
    finished, _ = wait(pending, timeout=_PATIENCE, return_when=FIRST_COMPLETED)
    if not finished and (why := pool.lost()):
        raise _lost(why)
    for future in [each for each in pending if each in finished]:  # in the order of the sources
        source = pending.pop(future)
        if future.cancelled():
            raise _lost(pool.lost() or "the cluster gave a task up")
        reply = future.result()
        if "refused" in reply:
            raise other_build(reply["refused"])
        journal.append(source, reply)
    return len(finished)


def other_build(build: str) -> InputError:
    """A worker has another version of Poise."""
    message = f"a worker runs Poise {build}, this is {this_build()}: install the same version on all machines"
    return InputError(ErrorCode.UNSUPPORTED, message)


def _lost(why: str) -> InputError:
    return InputError(ErrorCode.BAD_INPUT, f"{why}; what was answered is kept: run the same command again")
