"""Labels put away: a salted hash of each is public before anything is judged, the label itself comes to light after."""

import hashlib
import json
import secrets
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

PUBLIC = "seals.json"
"""In the bags' folder: {case: SHA-256 of salt + label}."""


@dataclass(frozen=True)
class Sealed:
    """A label and the salt that its seal was made with."""

    salt: str
    label: dict[str, Any]

    @property
    def seal(self) -> str:
        """SHA-256, hexadecimal, of the salt and the label's canonical JSON."""
        text = json.dumps(self.label, sort_keys=True, separators=(",", ":"), ensure_ascii=True, allow_nan=False)
        return hashlib.sha256(f"{self.salt}\n{text}".encode()).hexdigest()


def sealed(label: dict[str, Any]) -> Sealed:
    """A label with a random salt."""
    return Sealed(secrets.token_hex(32), json.loads(json.dumps(label, allow_nan=False)))


def private_file(folder: Path) -> Path:
    """Where the labels of a folder of bags go: beside it, not in it."""
    return folder.with_name(f"{folder.name}.seals.json")


def write_seals(folder: Path, labels: Mapping[str, Sealed]) -> None:
    """Publish the seals in the folder, and put the labels beside it, readable by their owner alone."""
    public = {case: entry.seal for case, entry in labels.items()}
    (folder / PUBLIC).write_text(json.dumps(public, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    private = {case: {"salt": entry.salt, "label": entry.label} for case, entry in labels.items()}
    target = private_file(folder)
    target.touch(mode=0o600)
    target.write_text(json.dumps(private, indent=1, sort_keys=True) + "\n", encoding="utf-8")


def open_seals(folder: Path, private: Path) -> dict[str, dict[str, Any]]:
    """The labels by case.

    Raises:
        ValueError: when a label is not the one that was sealed, or a case has none; naming the case.
    """
    public = json.loads((folder / PUBLIC).read_text(encoding="utf-8"))
    entries = json.loads(private.read_text(encoding="utf-8"))
    if public.keys() != entries.keys():
        odd = sorted(public.keys() ^ entries.keys())
        raise ValueError(f"{private} does not belong to {folder / PUBLIC}: {odd[0]} is in one of them alone")
    for case, entry in entries.items():
        if Sealed(entry["salt"], entry["label"]).seal != public[case]:
            raise ValueError(f"{case}: the label in {private} is not the one that was sealed")
    return {case: entry["label"] for case, entry in entries.items()}
