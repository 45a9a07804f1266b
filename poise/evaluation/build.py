"""Which Poise computes: its version and a digest of its sources, so that answers of two versions are never mixed."""

import hashlib
from functools import cache
from pathlib import Path

import poise

_ROOM = Path(__file__).resolve().parents[1]


@cache
def this_build() -> str:
    """Version and digest of the installed sources, such as `0.2.0+5f0c3a9be1d2`."""
    digest = hashlib.sha256()
    for path in sorted(_ROOM.rglob("*.py")):
        digest.update(str(path.relative_to(_ROOM)).encode() + path.read_bytes())
    return f"{poise.__version__}+{digest.hexdigest()[:12]}"
