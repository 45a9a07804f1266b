"""What a diagnosis found, written into the user's own model file, in the terms of its simulator.

- `base`: `ModelChanges`, what is written, and `ModelExporter`, the base class of an entry.
- `xml_text`: changes of an XML file that leave every other byte as it is.
- Every other file: one format. See docs/export_model.md.
"""

from functools import cache

from poise.exporting.models.base import (
    DriveChange,
    JointChange,
    LinkLoad,
    ModelChanges,
    ModelExporter,
    SensorChange,
    WrittenModel,
)
from poise.registry import entries_of, entry_called

__all__ = [
    "DriveChange",
    "JointChange",
    "LinkLoad",
    "ModelChanges",
    "ModelExporter",
    "SensorChange",
    "WrittenModel",
    "all_model_exporters",
    "model_exporter_of",
]


@cache
def all_model_exporters() -> tuple[ModelExporter, ...]:
    """Every exporter of models, by kind."""
    found: tuple[ModelExporter, ...] = entries_of(__name__, __path__, ModelExporter)  # type: ignore[type-abstract]
    return tuple(sorted(found, key=lambda exporter: exporter.kind))


def model_exporter_of(kind: str) -> ModelExporter:
    """The exporter of a kind.

    Raises:
        InputError: BAD_INPUT, with the kinds there are.
    """
    by_kind = {exporter.kind: exporter for exporter in all_model_exporters()}
    return entry_called(kind, by_kind, "no exporter of models writes")
