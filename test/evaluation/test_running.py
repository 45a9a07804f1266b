"""Runs over many sources: each is answered once, whatever happens to workers, to this process or to the disk."""

import json
import os
import resource
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from poise.errors import ErrorCode, InputError
from poise.evaluation import (
    DataSource,
    Journal,
    WorkerLimits,
    WorkerTask,
    cluster_pool,
    local_pool,
    run,
    this_build,
    unanswered,
)
from poise.evaluation.running import WorkerPool

FAKE = (sys.executable, str(Path(__file__).with_name("fake_worker.py")))
HEADING = {"job": "identify", "arguments": ["--method", "static"], "build": this_build()}


def task_of(source: DataSource, seconds: float = 60.0) -> WorkerTask:
    return WorkerTask("identify", (), source.name, "/", WorkerLimits(seconds, 0), this_build(), FAKE)


def quick(source: DataSource) -> WorkerTask:
    return task_of(source, 1.0)


def sources(folder: Path, *names: str) -> list[DataSource]:
    return [DataSource(str(folder / name), 1, 1.0) for name in names]


def replies(folder: Path) -> dict[str, dict]:
    with Journal(folder, HEADING) as journal:
        found = list(journal.entries())
    assert len({entry["name"] for entry in found}) == len(found), "answered twice"
    return {Path(entry["name"]).name: entry for entry in found}


def test_every_source_is_answered_once_by_several_workers(tmp_path: Path) -> None:
    wanted = sources(tmp_path, *(f"run_{number}" for number in range(50)))
    seen: list[int] = []
    with Journal(tmp_path, HEADING) as journal, local_pool(3) as pool:
        run(wanted, task_of, pool, journal, seen.append)
    assert len(replies(tmp_path)) == 50
    assert seen[-1] == 50


def test_a_worker_that_is_killed_is_replaced_and_its_source_answered_once(tmp_path: Path) -> None:
    wanted = sources(tmp_path, *(f"killed_once_{number}" for number in range(4)), *(f"run_{n}" for n in range(8)))
    with Journal(tmp_path, HEADING) as journal, local_pool(2) as pool:
        run(wanted, task_of, pool, journal)
    found = replies(tmp_path)
    assert len(found) == 12
    assert not any(entry["error"] for entry in found.values())


def test_a_source_that_ends_or_holds_up_its_worker_is_reported_and_stops_no_other(tmp_path: Path) -> None:
    wanted = sources(tmp_path, "deadly", "endless", "run_1", "run_2", "run_3")
    with Journal(tmp_path, HEADING) as journal, local_pool(2) as pool:
        run(wanted, quick, pool, journal)
    found = replies(tmp_path)
    assert found["deadly"]["error"]["name"] == "INTERNAL"
    assert "signal 9" in found["deadly"]["error"]["message"]
    assert found["endless"]["error"]["name"] == "DEADLINE"
    assert [found[f"run_{number}"]["error"] for number in (1, 2, 3)] == [None] * 3


def test_a_worker_of_another_version_is_refused_and_what_was_answered_is_kept(tmp_path: Path) -> None:
    wanted = sources(tmp_path, "run_1", "run_2", "outdated", "run_3")
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool, pytest.raises(InputError) as caught:
        run(wanted, task_of, pool, journal)
    assert caught.value.code is ErrorCode.UNSUPPORTED
    assert "0.0.1+old" in caught.value.message
    assert this_build() in caught.value.message
    assert set(replies(tmp_path)) == {"run_1", "run_2"}


def test_a_later_run_answers_what_is_missing_what_changed_and_on_request_what_failed(tmp_path: Path) -> None:
    first = sources(tmp_path, "deadly", "run_1", "run_2")
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool:
        run(first, task_of, pool, journal)
    changed = DataSource(str(tmp_path / "run_2"), 2, 7.0)
    later = [*first[:2], changed, *sources(tmp_path, "run_3")]
    with Journal(tmp_path, HEADING) as journal:
        assert unanswered(later, journal, retry=False) == later[2:]
        assert unanswered(later, journal, retry=True) == [later[0], *later[2:]]


def test_a_line_that_a_kill_cut_off_is_answered_again(tmp_path: Path) -> None:
    wanted = sources(tmp_path, "run_1", "run_2")
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool:
        run(wanted, task_of, pool, journal)
    path = tmp_path / "journal.jsonl"
    last = list(replies(tmp_path))[-1]  # of two that are ready at once, either may be written first
    path.write_bytes(path.read_bytes()[:-20])
    with Journal(tmp_path, HEADING) as journal:
        assert [Path(source.name).name for source in unanswered(wanted, journal, retry=False)] == [last]


@contextmanager
def full_disk(at: int) -> Iterator[None]:
    """Files cannot grow beyond a size: writes fail in the middle, as on a full disk."""
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    previous = signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
    resource.setrlimit(resource.RLIMIT_FSIZE, (at, before[1]))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
        signal.signal(signal.SIGXFSZ, previous)


def test_on_a_full_disk_what_was_done_is_kept_and_the_next_run_goes_on(tmp_path: Path) -> None:
    wanted = sources(tmp_path, *(f"run_{number:02}" for number in range(20)))
    refused = pytest.raises(InputError)
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool, refused as caught, full_disk(2000):
        run(wanted, task_of, pool, journal)
    assert caught.value.code is ErrorCode.FILE_UNWRITABLE
    assert "is kept" in caught.value.message
    kept = replies(tmp_path)
    assert 3 < len(kept) < 20
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool:
        missing = unanswered(wanted, journal, retry=False)
        run(missing, task_of, pool, journal)
    assert len(missing) == 20 - len(kept)
    assert len(replies(tmp_path)) == 20


@pytest.mark.parametrize(
    ("other", "named"),
    [({"job": "segment"}, "segment"), ({"arguments": []}, "--method static"), ({"build": "9.9+x"}, "9.9+x")],
)
def test_results_of_another_job_or_version_are_not_mixed(tmp_path: Path, other: dict, named: str) -> None:
    with Journal(tmp_path, HEADING):
        pass
    with pytest.raises(InputError, match="--results") as caught:
        Journal(tmp_path, HEADING | other)
    assert named in caught.value.message


def test_two_runs_do_not_write_into_one_folder(tmp_path: Path) -> None:
    with Journal(tmp_path, HEADING), pytest.raises(InputError) as caught:
        Journal(tmp_path, HEADING)
    assert caught.value.code is ErrorCode.BUSY


def test_what_is_no_journal_is_refused(tmp_path: Path) -> None:
    (tmp_path / "journal.jsonl").write_text("hello\n")
    with pytest.raises(InputError) as caught:
        Journal(tmp_path, HEADING)
    assert caught.value.code is ErrorCode.FILE_CORRUPT


# -- a cluster ----------------------------------------------------------------------------------------------------


@contextmanager
def dask_process(*arguments: str) -> Iterator[subprocess.Popen[str]]:
    command = [sys.executable, "-m", "dask", *arguments, "--no-dashboard"]
    process = subprocess.Popen(command, stderr=subprocess.PIPE, text=True, start_new_session=True)
    try:
        yield process
    finally:
        os.killpg(process.pid, signal.SIGKILL)
        process.communicate()


@contextmanager
def scheduler() -> Iterator[tuple[str, subprocess.Popen[str]]]:
    with dask_process("scheduler", "--port", "0", "--host", "127.0.0.1") as process:
        address = next(line for line in process.stderr or () if "Scheduler at:" in line).split()[-1]
        yield address, process


def test_a_cluster_answers_every_source_once_and_its_loss_keeps_what_was_answered(tmp_path: Path) -> None:
    wanted = sources(tmp_path, *(f"run_{number:03}" for number in range(300)))
    with scheduler() as (address, process), dask_process("worker", address, "--no-nanny", "--nthreads", "2"):
        with Journal(tmp_path / "whole", HEADING) as journal, cluster_pool(address) as pool:
            run(wanted, task_of, pool, journal)
        with Journal(tmp_path / "lost", HEADING) as journal, cluster_pool(address) as pool:

            def lose(done: int) -> None:
                if done >= 20 and process.poll() is None:
                    process.kill()

            with pytest.raises(InputError, match="is lost; what was answered is kept"):
                run(wanted, task_of, pool, journal, lose)
    assert len(replies(tmp_path / "whole")) == 300
    assert 20 <= len(replies(tmp_path / "lost")) < 300


def test_a_scheduler_that_is_not_there_and_one_without_workers_are_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("poise.evaluation.cluster._SECONDS", 0.5)
    with (
        pytest.raises(InputError, match="no Dask scheduler answers at tcp"),
        cluster_pool("tcp://127.0.0.1:9"),
    ):
        pass
    with pytest.raises(InputError, match="no Dask scheduler answers at nonsense"), cluster_pool("nonsense"):
        pass


def test_a_pool_that_is_lost_while_nothing_finishes_ends_the_run(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("poise.evaluation.running._PATIENCE", 0.05)
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool:
        lost = WorkerPool(pool.executor, pool.answer, 1, lambda: "the scheduler is lost")
        with pytest.raises(InputError, match="the scheduler is lost; what was answered is kept"):
            run(sources(tmp_path, "endless"), task_of, lost, journal)


def test_the_journal_has_one_line_of_json_for_each_source(tmp_path: Path) -> None:
    with Journal(tmp_path, HEADING) as journal, local_pool(1) as pool:
        run(sources(tmp_path, "run_1"), task_of, pool, journal)
    heading, line = map(json.loads, (tmp_path / "journal.jsonl").read_text().splitlines())
    assert heading == {"heading": HEADING}
    assert line["name"] == str(tmp_path / "run_1")
