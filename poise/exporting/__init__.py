"""An identified payload, and what a diagnosis found, in the formats of simulators, planners and robot controllers.

- `base`: `Exporter`, the base class of an entry; `settings`: the frame, the gripper, the robot; `inertials`: of XML.
- `models`: changes of the user's own model file, see there.
- Every other file: formats of one product. See docs/export.md and docs/add_an_exporter.md.
"""

from functools import cache

from poise.exporting.base import EXPORTED_VALUES, ExportedPayload, Exporter, is_doubtful
from poise.exporting.inertials import mjcf_inertial, sdf_inertial, urdf_inertial
from poise.exporting.settings import ExportSettings, GripperLoad
from poise.inertia import InertialEstimate
from poise.registry import entries_of, entry_called

__all__ = [
    "EXPORTED_VALUES",
    "ExportSettings",
    "ExportedPayload",
    "Exporter",
    "GripperLoad",
    "all_exporters",
    "export",
    "exported_payload",
    "exporter_of",
    "is_doubtful",
    "mjcf_inertial",
    "sdf_inertial",
    "urdf_inertial",
]


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
    return entry_called(kind, {exporter.kind: exporter for exporter in all_exporters()}, "no exporter writes")


def exported_payload(estimate: InertialEstimate, kind: str, settings: ExportSettings) -> ExportedPayload:
    """The payload as a kind writes it: in its frame, without the gripper.

    Raises:
        InputError: BAD_INPUT for an unknown kind.
        NoAnswerError: as `Exporter.check`.
    """
    exporter = exporter_of(kind)
    payload = ExportedPayload.of(estimate, settings, exporter.flange)
    exporter.check(payload)
    return payload


def export(estimate: InertialEstimate, kind: str, settings: ExportSettings | None = None) -> str:
    """An estimate as text of a kind.

    Args:
        estimate: the payload, in the sensor frame.
        kind: of `all_exporters`.
        settings: the frame, the gripper and the robot; None: the sensor frame, which is taken as the flange.

    Raises:
        InputError: BAD_INPUT for an unknown kind, or as `ExportSettings.robot_description` demands.
        NoAnswerError: as `Exporter.check`.
    """
    return exporter_of(kind).text(exported_payload(estimate, kind, settings or ExportSettings()))
