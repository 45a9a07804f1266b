"""Which files a path stands for: one file, the files of a rosbag2 folder in their order, or a mapping of tables."""

import re
from pathlib import Path, PurePath

import yaml

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import Loss, LossKind

_STORAGES = ("mcap", "sqlite3")
_COMPRESSION_MODES = ("none", "file", "message")
_SPLIT_ENDINGS = (".mcap", ".db3", ".mcap.zstd", ".db3.zstd")
_RECORDING_ENDINGS = (*_SPLIT_ENDINGS, ".bag")
_MAPPING = "columns.yaml"
_TABLE_ENDINGS = (".csv", ".tsv", ".txt", ".mat", ".npz")
_SPLIT_NUMBER = re.compile(r"_\d+(?=\.)")
"""Of a file of rosbag2."""


def find_files(path: Path) -> tuple[list[Path], list[Loss]]:
    """Return the files of a recording in the order of recording.

    A rosbag2 folder without metadata.yaml, as a recorder that was killed leaves it, gives its files by name, and a
    loss. A folder with columns.yaml gives that mapping.

    Raises:
        InputError: FILE_UNREADABLE (nothing there, no permission, no bag in the folder, a file of the bag missing),
            BAD_INPUT (several recordings that do not belong together), UNSUPPORTED (another storage or compression),
            FILE_CORRUPT (metadata.yaml).
    """
    try:
        if not path.exists():
            raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} does not exist: check the name")
        if not path.is_dir():
            return [path], []
        metadata = path / "metadata.yaml"
        if metadata.exists():
            return _listed_files(path, metadata.read_text(errors="replace")), []
        if (path / _MAPPING).exists():
            return [path / _MAPPING], []
        found = sorted(_ending_in(path, _SPLIT_ENDINGS), key=lambda file: (len(file.name), file.name))  # _2 before _10
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    if not found:
        sentence = f"{path} is a folder without a bag: give a recording, or a folder with metadata.yaml or {_MAPPING}"
        raise InputError(ErrorCode.FILE_UNREADABLE, sentence)
    if not _belong_together(found):
        names = ", ".join(file.name for file in found[:5]) + (", ..." if len(found) > 5 else "")
        sentence = f"{path} holds {len(found)} recordings ({names}): name one of them, or use `poise evaluate {path}`"
        raise InputError(ErrorCode.BAD_INPUT, sentence)
    kinds = ", ".join(sorted({file.suffix for file in found}))
    sentence = f"{path.name}: metadata.yaml is missing; the {kinds} files were taken by their names"
    return found, [Loss(LossKind.INDEX, 0, None, None, sentence, 0, metadata)]


def _belong_together(files: list[Path]) -> bool:
    """The files are the splits of one bag, NAME_0, NAME_1 and so on, or a single file."""
    stems = {_SPLIT_NUMBER.sub("", file.name) for file in files}
    return len(files) == 1 or (len(stems) == 1 and all(_SPLIT_NUMBER.search(file.name) for file in files))


def find_recordings(folder: str | Path) -> list[Path]:
    """The recordings in a folder, by name: bag files, folders of rosbag2, mappings of tables.

    A folder that is itself a recording gives itself.

    Raises:
        InputError: FILE_UNREADABLE when it is no folder or may not be read, EMPTY when it holds none.
    """
    folder = Path(folder)
    try:
        if (folder / "metadata.yaml").exists() or (folder / _MAPPING).exists():
            return [folder]
        folders = [path for path in folder.iterdir() if path.is_dir() and is_recording(path)]
        found = sorted([*folders, *_ending_in(folder, (*_RECORDING_ENDINGS, "." + _MAPPING))])
    except OSError as error:
        raise InputError(
            ErrorCode.FILE_UNREADABLE, f"cannot look into {folder}: {error.strerror}; give a folder with recordings"
        ) from error
    if not found:
        kinds = ", ".join(_RECORDING_ENDINGS)
        sentence = f"{folder} holds no recording ({kinds}, or a folder of rosbag2): give the folder with the recordings"
        raise InputError(ErrorCode.EMPTY, sentence)
    return found


def skipped_entries(folder: str | Path, found: list[Path]) -> list[str]:
    """The names in a folder that `find_recordings` left out, folders with a slash; tables belong to their mapping.

    Args:
        folder: where.
        found: its recordings.
    """
    folder = Path(folder)
    if folder in found:
        return []
    tables = _TABLE_ENDINGS if any(path.name.endswith(_MAPPING) for path in found) else ()
    left = (path for path in folder.iterdir() if path not in found and not path.name.startswith("."))
    return sorted(path.name + "/" * path.is_dir() for path in left if path.suffix.lower() not in tables)


def is_recording(folder: Path) -> bool:
    """Whether a folder is one recording: of rosbag2, or of tables with their mapping."""
    if any((folder / name).exists() for name in ("metadata.yaml", _MAPPING)):
        return True
    files = _ending_in(folder, _SPLIT_ENDINGS)  # a killed recorder leaves them without metadata.yaml
    return bool(files) and _belong_together(files) and all(_SPLIT_NUMBER.search(file.name) for file in files)


def _ending_in(folder: Path, endings: tuple[str, ...]) -> list[Path]:
    return [path for path in folder.iterdir() if path.name.endswith(endings) and not path.is_dir()]


def _listed_files(folder: Path, text: str) -> list[Path]:
    """Read what metadata.yaml lists; only names inside of the folder count."""
    try:
        information = yaml.safe_load(text)["rosbag2_bagfile_information"]
        storage = str(information["storage_identifier"])
        mode = str(information.get("compression_mode") or "none").lower()
        compression = str(information.get("compression_format") or "zstd").lower()
        names = [PurePath(str(name)).name for name in information["relative_file_paths"]]
    except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        fix = "move it away to have the files read by their names, or write it again with `ros2 bag reindex`"
        sentence = f"{folder / 'metadata.yaml'} is damaged: {fix}"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence) from error
    if storage not in _STORAGES:
        sentence = f"{folder} is stored as {storage}, not mcap or sqlite3: convert it with `ros2 bag convert`"
        raise InputError(ErrorCode.UNSUPPORTED, sentence)
    if mode not in _COMPRESSION_MODES or (mode != "none" and compression != "zstd"):
        sentence = f"{folder} is compressed by {compression} ({mode}), only zstd is read: use `ros2 bag convert`"
        raise InputError(ErrorCode.UNSUPPORTED, sentence)
    if not names:
        raise InputError(ErrorCode.EMPTY, f"{folder / 'metadata.yaml'} lists no files: record again")
    files = [_as_stored(folder / name) for name in names]
    missing = [name for name, file in zip(names, files, strict=True) if not file.exists()]
    if missing:
        sentence = f"{folder} lacks {', '.join(missing)}, which metadata.yaml lists: copy it too"
        raise InputError(ErrorCode.FILE_UNREADABLE, sentence)
    return files


def _as_stored(file: Path) -> Path:
    """The file, or its compressed or decompressed form when only that is there."""
    other = file.with_suffix("") if file.suffix == ".zstd" else file.with_name(file.name + ".zstd")
    return other if other.exists() and not file.exists() else file
