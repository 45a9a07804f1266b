"""A Dask cluster as a pool of workers: the scheduler assigns tasks, each machine answers in processes of its own."""

import logging
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from poise.errors import ErrorCode, InputError
from poise.evaluation.build import this_build
from poise.evaluation.running import WorkerPool, other_build
from poise.evaluation.workers import answer_on_cluster

_SECONDS = 10
"""That a scheduler has to answer, and that a first worker has to appear."""


@contextmanager
def cluster_pool(address: str) -> Iterator[WorkerPool]:
    """The workers of the Dask scheduler at an address, such as `tcp://10.0.0.5:8786`.

    Raises:
        InputError: UNSUPPORTED without distributed, and when a worker has another version of Poise or none;
            BAD_INPUT when there is no scheduler, or no worker.
    """
    try:
        from distributed import Client
    except ImportError as error:
        raise InputError(
            ErrorCode.UNSUPPORTED, "--scheduler needs Dask, which is not installed: pip install 'poise[fleet]'"
        ) from error
    logging.getLogger("distributed").setLevel(logging.CRITICAL)  # what matters of it becomes one of our errors
    make: Any = Client  # it has no types
    try:
        client = make(address, timeout=_SECONDS, set_as_default=False)
    except (OSError, ValueError) as error:  # a timeout is an OSError
        message = f"no Dask scheduler answers at {address}: start one with `dask scheduler`, or check the address"
        raise InputError(ErrorCode.BAD_INPUT, message) from error
    try:
        _check_workers(client, address)
        threads = sum(client.nthreads().values())

        def lost() -> str:
            return "" if client.status == "running" else f"the Dask scheduler at {address} is lost"

        yield WorkerPool(client.get_executor(pure=False), answer_on_cluster, threads, lost)
    finally:
        client.close(timeout=_SECONDS)


def _check_workers(client: Any, address: str) -> None:
    """There are workers, and all of them have this version of Poise."""
    try:
        client.wait_for_workers(1, timeout=_SECONDS)
    except TimeoutError as error:
        message = f"the Dask scheduler at {address} has no workers: start some with `dask worker {address}`"
        raise InputError(ErrorCode.BAD_INPUT, message) from error
    try:
        builds = client.run(this_build)
    except Exception as error:
        message = (
            f"a worker of {address} has no Poise like this one ({type(error).__name__}: {error}): install it there"
        )
        raise InputError(ErrorCode.UNSUPPORTED, message) from error
    for build in builds.values():
        if build != this_build():
            raise other_build(build)
