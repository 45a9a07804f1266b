"""What a diagnosis found, written into the user's own model file, in the terms of its simulator.

- `base`: `ModelChanges`, what is written, and `ModelExporter`, the base class of an entry.
- `xml_text`: changes of an XML file that leave every other byte as it is.
- Every other file: one format. See docs/export_model.md.
"""

from functools import cache

from poise.errors import ErrorCode, InputError
from poise.exporting.models.base import JointChange, LinkLoad, ModelChanges, ModelExporter
from poise.registry import entries_of

__all__ = ["JointChange", "LinkLoad", "ModelChanges", "ModelExporter", "all_model_exporters", "model_exporter_of"]


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
    for exporter in all_model_exporters():
        if exporter.kind == kind:
            return exporter
    kinds = ", ".join(exporter.kind for exporter in all_model_exporters())
    raise InputError(ErrorCode.BAD_INPUT, f"no exporter of models writes {kind!r}; use one of {kinds}")
