"""Files that are written whole or not at all, and files of installed packages by their URI."""

import contextlib
import hashlib
import os
import secrets
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from poise.errors import ErrorCode, InputError


def package_file(uri: str) -> Path:
    """The path that a URI package://NAME/path names; any other text is a path already.

    Raises:
        InputError: FILE_UNREADABLE for a package that is not on AMENT_PREFIX_PATH, UNSUPPORTED for a path that leaves
            the package's share folder.
    """
    if not uri.startswith("package://"):
        return Path(uri)
    package, _, inside = uri.removeprefix("package://").partition("/")
    for prefix in os.environ.get("AMENT_PREFIX_PATH", "").split(os.pathsep):
        shares = Path(prefix) / "share"
        if prefix and package and is_inside(shares / package, shares) and (shares / package).is_dir():
            path = shares / package / inside
            if not is_inside(path, shares / package):
                raise InputError(ErrorCode.UNSUPPORTED, f"{uri}: leaves the package's share folder")
            return path
    raise InputError(ErrorCode.FILE_UNREADABLE, f"{uri}: no package {package!r} on AMENT_PREFIX_PATH")


def is_inside(path: Path, folder: Path) -> bool:
    """Whether a path stays below a folder by its words; links are not followed (colcon makes many)."""
    return Path(os.path.normpath(path.absolute())).is_relative_to(os.path.normpath(folder.absolute()))


def write_whole(path: Path, content: bytes) -> Path:
    """Write a file through a temporary one beside it, so that a reader sees the old file or the new, never a part.

    Args:
        path: target; missing folders above it are made.
        content: all of it.

    Returns:
        The path.

    Raises:
        InputError: FILE_UNWRITABLE (disk full, no permission, a file where a folder should be, a bad name).
    """
    draft = path.parent / f".poise-{secrets.token_hex(8)}.tmp"
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with draft.open("xb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        draft.replace(path)
    except (OSError, ValueError) as error:  # ValueError: a NUL in the name
        reason = getattr(error, "strerror", None) or str(error)
        raise InputError(
            ErrorCode.FILE_UNWRITABLE,
            f"cannot write {str(path)!r}: {reason}; free some space or choose another folder",
            path=str(path),
        ) from error
    finally:
        with contextlib.suppress(OSError, ValueError):
            draft.unlink(missing_ok=True)
    return path


def sha256_of(path: Path) -> str:
    """SHA-256 of a file; empty for what is none or cannot be read."""
    try:
        with path.open("rb") as file:
            return hashlib.file_digest(file, "sha256").hexdigest()
    except (OSError, ValueError):
        return ""


def yaml_documents(text: str) -> Iterator[Any]:
    """The documents of a YAML text, as `yaml.safe_load_all`; by libyaml, a few times as fast, where PyYAML has it.

    Raises:
        yaml.YAMLError: when the text is not YAML, or nested more than a thousand deep.
    """
    import yaml

    loader = getattr(yaml, "CSafeLoader", yaml.SafeLoader)(text)
    try:
        while loader.check_data():
            yield loader.get_data()
    finally:
        loader.dispose()
