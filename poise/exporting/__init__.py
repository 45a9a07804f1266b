"""An identified payload in the formats of simulators, planners and robot controllers.

- `base`: `Exporter`, the base class of an entry. Every other file: one format. See docs/add_an_exporter.md.
"""

from functools import cache

from poise.errors import ErrorCode, InputError
from poise.exporting.base import EXPORTED_VALUES, ExportedPayload, Exporter
from poise.geometry import Pose
from poise.inertia import InertialEstimate
from poise.registry import entries_of

__all__ = ["EXPORTED_VALUES", "ExportedPayload", "Exporter", "all_exporters", "export", "exporter_of"]


@cache
def all_exporters() -> tuple[Exporter, ...]:
    """Every exporter of the registry, by kind."""
    found: tuple[Exporter, ...] = entries_of(__name__, __path__, Exporter)  # type: ignore[type-abstract]
    return tuple(sorted(found, key=lambda exporter: exporter.kind))


def exporter_of(kind: str) -> Exporter:
    """The exporter of a kind.

    Raises:
        InputError: BAD_INPUT, with the kinds there are.
    """
    for exporter in all_exporters():
        if exporter.kind == kind:
            return exporter
    kinds = ", ".join(exporter.kind for exporter in all_exporters())
    raise InputError(ErrorCode.BAD_INPUT, f"no exporter writes {kind!r}; use one of {kinds}")


def export(estimate: InertialEstimate, kind: str, flange_from_sensor: Pose | None = None) -> str:
    """An estimate as text of a kind.

    Args:
        estimate: the payload, in the sensor frame.
        kind: of `all_exporters`.
        flange_from_sensor: pose of the sensor frame in the flange frame, for formats that take values in the flange
            frame; None: both coincide, or the caller moves the values. Other formats stay in the sensor frame.

    Raises:
        InputError: BAD_INPUT for an unknown kind.
        NoAnswerError: as `Exporter.check`.
    """
    exporter = exporter_of(kind)
    payload = ExportedPayload.of(estimate, flange_from_sensor if exporter.flange else None)
    exporter.check(payload)
    return exporter.text(payload)
