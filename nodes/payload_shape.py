"""The shape of what is held: poise_msgs/SegmentedObject to parts."""

import numpy as np

from poise.errors import ErrorCode, InputError
from poise.inertia import InertialParameters
from poise.inertia.model import Parts, cloud_accuracy, symmetric
from poise_msgs.msg import Part, SegmentedObject


def accuracy_of(message: SegmentedObject) -> float:
    """Relative error of lengths in a scan."""
    return cloud_accuracy(message.volume, message.volume_std)


def parts_of_message(message: SegmentedObject) -> Parts:
    """In the object's own frame.

    Raises:
        InputError: OBJECT_INVALID, naming the part, for numbers that no body has.
    """
    if not message.parts:
        raise InputError(ErrorCode.OBJECT_INVALID, f"segmented object {message.id!r} has no parts: segment it first")
    phi = np.array([_unit_phi(part, message.id) for part in message.parts]).T
    corners = [[point.x, point.y, point.z] for part in message.parts for point in part.surface.vertices]
    return Parts(phi, np.array([part.volume for part in message.parts]), np.array(corners).reshape(-1, 3))


def _unit_phi(part: Part, name: str) -> list[float]:
    given = part.unit_inertia
    com = np.array([given.com.x, given.com.y, given.com.z])
    inertia = symmetric([given.ixx, given.ixy, given.ixz, given.iyy, given.iyz, given.izz])
    finite = np.isfinite(com).all() and np.isfinite(inertia).all()
    unit = InertialParameters(1.0, com, inertia) if finite else None
    if unit is None or not unit.is_consistent or not (np.isfinite(part.volume) and part.volume > 0):
        raise InputError(
            ErrorCode.OBJECT_INVALID,
            f"part {part.label} of segmented object {name!r}: no body has this volume and inertia per kg; give m3, and"
            " the inertia about the centre of mass in m2",
        )
    return list(unit.phi)
