"""Sealed labels: the folder of cases holds a salted hash of each, the labels lie beside the folder."""

import hashlib
import json
import secrets
from collections.abc import Mapping
from pathlib import Path
from typing import Any

PUBLIC = "seals.json"


def truth_file(folder: Path) -> Path:
    """The file of labels and salts that belongs to a folder of cases."""
    return folder.parent / f"{folder.name}.truth.json"


def seal(folder: Path, labels: Mapping[str, dict[str, Any]]) -> None:
    """Write the hashes into the folder, and labels and salts beside it, for their owner alone."""
    entries = {case: {"salt": secrets.token_hex(16), "label": label} for case, label in labels.items()}
    hashes = {case: _digest(entry) for case, entry in entries.items()}
    (folder / PUBLIC).write_text(json.dumps(hashes, indent=1) + "\n", encoding="utf-8")
    target = truth_file(folder)
    target.touch(mode=0o600)
    target.write_text(json.dumps(entries, indent=1) + "\n", encoding="utf-8")


def unseal(folder: Path) -> dict[str, dict[str, Any]]:
    """The labels by case.

    Raises:
        ValueError: a label does not give its hash, or there are labels for other cases.
    """
    hashes = json.loads((folder / PUBLIC).read_text(encoding="utf-8"))
    entries = json.loads(truth_file(folder).read_text(encoding="utf-8"))
    wrong = [case for case in hashes.keys() | entries.keys() if hashes.get(case) != _digest(entries.get(case))]
    if wrong:
        raise ValueError(f"{truth_file(folder)}: {len(wrong)} labels do not give their hashes, {min(wrong)} among them")
    return {case: entry["label"] for case, entry in entries.items()}


def _digest(entry: Any) -> str:
    return hashlib.sha256(json.dumps(entry, sort_keys=True).encode()).hexdigest()
