"""The notebooks run as they are committed, and print what is stored in them."""

import re
from pathlib import Path
from typing import Any

import pytest

nbformat = pytest.importorskip("nbformat")
nbclient = pytest.importorskip("nbclient")

ROOT = Path(__file__).resolve().parents[1]
NOTEBOOKS = sorted((ROOT / "docs" / "notebooks").glob("*.ipynb"))
CHANGES = re.compile(r", [\d.]+ s\)")
"""Seconds of a computation."""


def shown(notebook: Any) -> list[str]:
    """The text of each output in order; of a picture, that there is one."""
    found = []
    for cell in notebook.cells:
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            text = data.get("text/html") or data.get("text/plain") or output.get("text", "")
            found.append("a picture" if "image/png" in data else CHANGES.sub("", text))
    return found


@pytest.mark.slow
@pytest.mark.parametrize("path", NOTEBOOKS, ids=lambda path: path.stem)
def test_a_notebook_runs_and_shows_what_is_stored_in_it(path: Path) -> None:
    stored = nbformat.read(path, as_version=4)
    run = nbformat.read(path, as_version=4)
    nbclient.NotebookClient(run, timeout=300, resources={"metadata": {"path": str(path.parent)}}).execute()
    assert shown(run) == shown(stored)
    assert any("<table>" in text for text in shown(run)), "a result has a table of its own"
    assert "a picture" in shown(run)
