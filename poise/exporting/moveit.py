"""MoveIt: an attached object of the planning scene (moveit_msgs/AttachedCollisionObject)."""

import numpy as np
import scipy
import yaml

from poise.exporting.base import ExportedPayload, Exporter

_ADD = 0
"""moveit_msgs/CollisionObject.ADD, as a byte."""
_BOX = 1
"""shape_msgs/SolidPrimitive.BOX."""


class MoveitExporter(Exporter):
    """The weight, and the uniform box that has the payload's mass, centre of mass and inertia.

    The planning scene knows no inertia; dynamics solvers read it from the robot description, so export urdf for them.
    """

    kind = "moveit"
    summary = "MoveIt: attached collision object with weight and the box of equal inertia"
    omits = ("inertia",)

    def text(self, payload: ExportedPayload) -> str:
        """YAML of the message, as `ros2 topic pub` takes it."""
        parameters = payload.parameters
        moments, axes = np.linalg.eigh(parameters.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        # I_x = m (b2 + c2) / 12 and so on, solved for the edges.
        edges = np.sqrt(np.maximum(6 * (moments.sum() - 2 * moments) / parameters.mass, 0.0))
        pose = {
            "position": dict(zip("xyz", parameters.com.tolist(), strict=True)),
            "orientation": dict(
                zip("xyzw", scipy.spatial.transform.Rotation.from_matrix(axes).as_quat().tolist(), strict=True)
            ),
        }
        message = {
            "link_name": payload.frame_id,
            "weight": parameters.mass,
            "object": {
                "header": {"frame_id": payload.frame_id},
                "id": "payload",
                "primitives": [{"type": _BOX, "dimensions": edges.tolist()}],
                "primitive_poses": [pose],
                "operation": _ADD,
            },
        }
        return f"# {payload.remark}\n{yaml.safe_dump(message, sort_keys=False)}"
