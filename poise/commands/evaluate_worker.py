"""A worker of `poise evaluate`: reads tasks from stdin, runs the subcommand on each, writes replies to stdout."""

import contextlib
import gc
import io
import json
import os
import resource
import sys
import tempfile
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from poise.cli import load_command
from poise.errors import ErrorCode, InputError, PoiseError
from poise.evaluation import JOBS, RECORDINGS, failed, file_system, is_url, this_build, unreachable
from poise.files import sha256_of
from poise.recording import open_recording

_LONGEST = 256
"""Entries of a list that is kept; longer ones (a label for each point) are left to the single command."""

command = cache(load_command)


def main() -> None:
    """Serve tasks until stdin ends; the argument bounds the memory in bytes, 0 not at all."""
    if (memory := int(sys.argv[1])) > 0:
        resource.setrlimit(resource.RLIMIT_DATA, (memory, memory))
    gc.set_threshold(20_000)
    replies = os.fdopen(os.dup(sys.stdout.fileno()), "wb")
    os.dup2(sys.stderr.fileno(), sys.stdout.fileno())  # what libraries print is no reply
    for line in sys.stdin.buffer:
        replies.write(json.dumps(reply_to(json.loads(line)), ensure_ascii=False).encode() + b"\n")
        replies.flush()


def reply_to(task: dict[str, Any]) -> dict[str, Any]:
    """The reply to a task: the subcommand's JSON, its error, its warnings, and what is known of the source."""
    if task["build"] != this_build():
        return {"refused": this_build()}
    if Path(task["folder"]).is_dir():
        os.chdir(task["folder"])
    start = time.perf_counter()
    try:
        with _fetched(task["source"]) as path:
            reply = run_job(task["job"], [*task["arguments"], path])
            reply |= {"sha256": _digest(Path(path)), "stamp": _stamp(task["job"], reply["answer"], path)}
    except PoiseError as error:
        return failed(error.code, error.message, error.exit_status)
    if path != task["source"]:
        reply = json.loads(json.dumps(reply).replace(path, task["source"]))
    return reply | {"seconds": time.perf_counter() - start}


def run_job(job: str, arguments: list[str]) -> dict[str, Any]:
    """Run a subcommand in this process: its JSON answer (None: none was written), its error, its warnings."""
    printed, said = io.StringIO(), io.StringIO()
    reply: dict[str, Any] = {"answer": None, "error": None, "build": this_build()}
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(said):
            command(job).main([*arguments, "--json", "-"], prog_name=f"poise {job}", standalone_mode=False)
    except PoiseError as error:
        reply = failed(error.code, error.message, error.exit_status)
    except MemoryError:
        limit = resource.getrlimit(resource.RLIMIT_DATA)[0] / 1e9
        reply = failed(ErrorCode.UNSUPPORTED, f"{arguments[-1]}: needs more than {limit:.1f} GB; raise --memory")
    except Exception as error:
        usage = getattr(error, "format_message", None)
        if usage is not None:
            raise InputError(ErrorCode.BAD_INPUT, usage()) from error
        message = f"{arguments[-1]}: internal error: {type(error).__name__}: {error}"
        reply = failed(ErrorCode.INTERNAL, message, 1)
    with contextlib.suppress(ValueError):
        reply["answer"] = _short(json.loads(printed.getvalue()))
    reply["warnings"] = [line.removeprefix("poise: warning: ") for line in said.getvalue().splitlines() if line]
    return reply


def _short(value: Any) -> Any:
    """The answer without its long lists."""
    if isinstance(value, dict):
        return {key: _short(item) for key, item in value.items() if not isinstance(item, list) or len(item) <= _LONGEST}
    return [_short(item) for item in value] if isinstance(value, list) else value


@contextlib.contextmanager
def _fetched(source: str) -> Iterator[str]:
    """The path of a source; of a URL, that of a copy that is deleted afterwards."""
    if not is_url(source):
        yield source
        return
    files, there = file_system(source)
    with tempfile.TemporaryDirectory(prefix="poise-evaluate-") as folder:
        path = str(Path(folder) / Path(there.rstrip("/")).name)
        try:
            files.get(there, path, recursive=files.isdir(there))
        except Exception as error:
            raise unreachable(source, error) from error
        yield path


def _digest(path: Path) -> str:
    """SHA-256 of a file, or of the files of a folder in their order."""
    if not path.is_dir():
        return sha256_of(path)
    return "".join(sha256_of(file)[:16] for file in sorted(path.iterdir()) if file.is_file())


def _stamp(job: str, answer: Any, path: str) -> float | None:
    """The newest stamp of a recording, s since 1970; None for what is none."""
    if isinstance(answer, dict) and isinstance(answer.get("stamp"), float):
        return float(answer["stamp"])
    if answer is None or JOBS[job].kind is not RECORDINGS:
        return None
    return 1e-9 * open_recording(path).newest


if __name__ == "__main__":
    main()
