"""Which .mcap files a path stands for: one file, or the files of a rosbag2 folder in their order."""

from pathlib import Path, PurePath

import yaml

from poise.errors import ErrorCode, InputError
from poise.recording.blocks import Loss, LossKind


def find_files(path: Path) -> tuple[list[Path], list[Loss]]:
    """Return the .mcap files in the order of recording.

    A folder without metadata.yaml, as a recorder that was killed leaves it, gives its .mcap files by name, and a loss.

    Raises:
        InputError: FILE_UNREADABLE (nothing there, no permission, no bag in the folder, a file of the bag missing),
            UNSUPPORTED (another storage than mcap, or compressed as a whole), FILE_CORRUPT (metadata.yaml).
    """
    try:
        if not path.exists():
            raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} does not exist: check the name")
        if not path.is_dir():
            return [path], []
        metadata = path / "metadata.yaml"
        if metadata.exists():
            return _listed_files(path, metadata.read_text(errors="replace")), []
        found = sorted(path.glob("*.mcap"), key=lambda file: (len(file.name), file.name))  # _2 before _10
    except OSError as error:
        raise InputError(ErrorCode.FILE_UNREADABLE, f"{path} cannot be read: {error.strerror}") from error
    if not found:
        sentence = f"{path} is a folder without a bag: give an .mcap file or a folder with metadata.yaml"
        raise InputError(ErrorCode.FILE_UNREADABLE, sentence)
    sentence = f"{path.name}: metadata.yaml is missing; the .mcap files were taken by their names"
    return found, [Loss(LossKind.INDEX, 0, None, None, sentence, 0, metadata)]


def _listed_files(folder: Path, text: str) -> list[Path]:
    """Read what metadata.yaml lists; only names inside of the folder count."""
    try:
        information = yaml.safe_load(text)["rosbag2_bagfile_information"]
        storage = str(information["storage_identifier"])
        compressed = information.get("compression_mode") or "none"
        names = [PurePath(str(name)).name for name in information["relative_file_paths"]]
    except (yaml.YAMLError, KeyError, TypeError, AttributeError) as error:
        sentence = f"{folder / 'metadata.yaml'} is damaged: `ros2 bag reindex` writes it anew"
        raise InputError(ErrorCode.FILE_CORRUPT, sentence) from error
    if storage != "mcap" or compressed.lower() != "none":
        what = f"is stored as {storage}" if storage != "mcap" else f"is compressed by {compressed}"
        sentence = f"{folder} {what}: convert it to plain mcap with `ros2 bag convert`"
        raise InputError(ErrorCode.UNSUPPORTED, sentence)
    if not names:
        raise InputError(ErrorCode.EMPTY, f"{folder / 'metadata.yaml'} lists no files: record again")
    missing = [name for name in names if not (folder / name).exists()]
    if missing:
        sentence = f"{folder} lacks {', '.join(missing)}, which metadata.yaml lists: copy it too"
        raise InputError(ErrorCode.FILE_UNREADABLE, sentence)
    return [folder / name for name in names]
