"""What to evaluate: files in folders, behind globs and at URLs, each once, in the order of their names."""

import glob
import os
import posixpath
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, InputError
from poise.recording import find_recordings, is_recording, skipped_entries

TRUTH_ENDINGS = (".truth.yaml", ".truth.json")
"""Of files with the truth about a source of the same name."""
_MAGIC = "*?["
_BAG_FOLDER = "metadata.yaml"


@dataclass(frozen=True)
class SourceKind:
    """What a job reads: its name for messages, and how such files end; recordings may also be folders."""

    name: str
    endings: tuple[str, ...]

    def fits(self, name: str) -> bool:
        """Whether a file of this name is one."""
        return name.endswith(self.endings) and not name.endswith(TRUTH_ENDINGS)

    @property
    def folders(self) -> bool:
        """Whether a folder can be one."""
        return self.name == "recording"


RECORDINGS = SourceKind("recording", (".mcap", ".db3", ".mcap.zstd", ".db3.zstd", ".bag", "columns.yaml"))
CLOUDS = SourceKind("point cloud", (".ply", ".pcd", ".xyz", ".csv", ".npy"))
SCENES = SourceKind("scene", (".yaml", ".yml", ".sdf", ".world", ".xml", ".mjcf", ".urdf", ".scene"))


@dataclass(frozen=True)
class DataSource:
    """One thing to evaluate.

    Args:
        name: path or URL, as it is shown and as it identifies the source in results.
        size: bytes; None for a folder, and where a server does not say.
        modified: s since 1970; None where unknown.
    """

    name: str
    size: int | None = None
    modified: float | None = None

    @property
    def remote(self) -> bool:
        """Whether it is a URL."""
        return is_url(self.name)

    @property
    def folder(self) -> str:
        """Name of the folder that it lies in."""
        return posixpath.basename(posixpath.dirname(self.name.partition("::")[0].rstrip("/")))


def is_url(text: str) -> bool:
    """Whether a source is a URL of fsspec and not a path."""
    return "://" in text


def find_sources(patterns: Sequence[str], kind: SourceKind) -> tuple[list[DataSource], list[str]]:
    """The sources that folders, globs, paths and URLs stand for, and the names in folders that are none.

    Raises:
        InputError: FILE_UNREADABLE for a path or server that is not there, EMPTY when nothing is found, UNSUPPORTED for
            URLs without fsspec or the package of their protocol.
    """
    found: dict[str, DataSource] = {}
    skipped: list[str] = []
    for pattern in patterns:
        sources, others = _remote(pattern, kind) if is_url(pattern) else _local(pattern, kind)
        for source in sources:
            found.setdefault(source.name if source.remote else os.path.realpath(source.name), source)
        skipped += others
    if not found:
        where = ", ".join(patterns)
        raise InputError(ErrorCode.EMPTY, f"{where}: no {kind.name} ({', '.join(kind.endings)}) matches")
    return sorted(found.values(), key=lambda source: source.name), skipped


# -- paths --------------------------------------------------------------------------------------------------------


def _local(pattern: str, kind: SourceKind) -> tuple[list[DataSource], list[str]]:
    path = Path(pattern)
    skipped: list[str] = []
    if path.is_dir() and kind.folders:
        paths = find_recordings(path)
        skipped = skipped_entries(path, paths)
    elif path.is_dir():
        paths = sorted(entry for entry in path.iterdir() if kind.fits(entry.name))
    elif path.exists():
        paths = [path]
    elif any(letter in pattern for letter in _MAGIC):
        paths = list(_matches(pattern, kind))
    else:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{pattern} does not exist: check the name")
    return [_stated(path) for path in paths], skipped


def _matches(pattern: str, kind: SourceKind) -> Iterator[Path]:
    """What a glob matches; the files inside of a matching recording folder are not sources of their own."""
    paths = [Path(match) for match in sorted(glob.glob(pattern, recursive=True))]  # noqa: PTH207 (absolute ones too)
    folders = {path for path in paths if kind.folders and path.is_dir() and is_recording(path)}
    for path in paths:
        if path in folders or (kind.fits(path.name) and path.is_file() and path.parent not in folders):
            yield path


def _stated(path: Path) -> DataSource:
    try:
        state = path.stat()
    except OSError:  # it vanished, or may not be read: its answer says so
        return DataSource(str(path))
    return DataSource(str(path), None if path.is_dir() else state.st_size, state.st_mtime)


# -- URLs ---------------------------------------------------------------------------------------------------------


def file_system(url: str) -> tuple[Any, str]:
    """The file system of fsspec for a URL, and the path in it.

    Raises:
        InputError: UNSUPPORTED without fsspec or the package of the protocol, FILE_UNREADABLE.
    """
    try:
        import fsspec.core
    except ImportError as error:
        raise InputError(
            ErrorCode.UNSUPPORTED, f"{url}: URLs need fsspec, which is not installed: pip install 'poise[fleet]'"
        ) from error
    try:
        return fsspec.core.url_to_fs(url)  # type: ignore[no-any-return]
    except ImportError as error:  # "Install s3fs to access S3"
        raise InputError(ErrorCode.UNSUPPORTED, f"{url}: {error}") from error
    except Exception as error:
        raise unreachable(url, error) from error


def unreachable(url: str, error: Exception) -> InputError:
    """The error of a URL; file systems raise exceptions of many kinds."""
    return InputError(ErrorCode.FILE_UNREADABLE, f"{url} cannot be read: {type(error).__name__}: {error}")


def _remote(url: str, kind: SourceKind) -> tuple[list[DataSource], list[str]]:
    files, path = file_system(url)
    try:
        if any(letter in path for letter in _MAGIC):
            entries = list(files.glob(path, detail=True).values())
        elif files.isdir(path) and not (kind.folders and files.exists(posixpath.join(path, _BAG_FOLDER))):
            entries = files.ls(path, detail=True)
        else:
            entries = [files.info(path)]
        chosen = [entry for entry in entries if _fits(files, entry, kind)]
    except Exception as error:
        raise unreachable(url, error) from error
    _, chained, rest = url.partition("::")
    names = {entry["name"]: files.unstrip_protocol(entry["name"]) + chained + rest for entry in entries}
    sources = [DataSource(names[entry["name"]], entry.get("size") or None, _modified(entry)) for entry in chosen]
    return sources, [posixpath.basename(name.rstrip("/")) for name in _others(entries, chosen)]


def _others(entries: Iterable[dict[str, Any]], chosen: list[dict[str, Any]]) -> list[str]:
    return [entry["name"] for entry in entries if entry not in chosen]


def _fits(files: Any, entry: dict[str, Any], kind: SourceKind) -> bool:
    if entry.get("type") == "directory":
        return kind.folders and bool(files.exists(posixpath.join(entry["name"], _BAG_FOLDER)))
    return kind.fits(str(entry["name"]))


def _modified(entry: dict[str, Any]) -> float | None:
    for key in ("mtime", "LastModified", "last_modified", "updated", "created"):
        value: Any = entry.get(key)
        if isinstance(value, int | float):
            return float(value)
        if hasattr(value, "timestamp"):
            return float(value.timestamp())
    return None
