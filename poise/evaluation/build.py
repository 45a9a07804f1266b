"""Which Poise computes: its version and a digest of its sources, so that answers of two versions are never mixed."""

import hashlib
import os
from functools import cache
from pathlib import Path

import poise

_ROOM = Path(__file__).resolve().parents[1]


@cache
def this_build() -> str:
    """Version and digest of the sources, such as `0.2.0+5f0c3a9be1d2`; the same for a checkout and its installation."""
    digest = hashlib.sha256()
    # Two rooms are links in a checkout, and folders where Poise is installed.
    folders = os.walk(_ROOM, followlinks=True)
    paths = [Path(folder) / name for folder, _, names in folders for name in names if name.endswith(".py")]
    for path in sorted(paths):
        digest.update(str(path.relative_to(_ROOM)).encode() + path.read_bytes())
    return f"{poise.__version__}+{digest.hexdigest()[:12]}"
