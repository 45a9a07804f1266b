"""KUKA: a line of KRL (system variable `$LOAD`, structure LOAD; e.g. MA KR IONTEC, section 4.3, loads)."""

import numpy as np
import scipy

from poise.exporting.base import ExportedPayload, Exporter


class KukaExporter(Exporter):
    """`$LOAD`: M in kg; CM in mm and degrees, the pose of the principal axes of inertia in the flange frame (A about z,
    then B about y, then C about x); J in kg m2, the principal moments.
    """

    kind = "kuka"
    summary = "KUKA: assignment of $LOAD in KRL"
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """The assignment."""
        parameters = payload.parameters
        moments, axes = np.linalg.eigh(parameters.inertia)
        axes[:, 2] *= np.sign(np.linalg.det(axes))
        angles = scipy.spatial.transform.Rotation.from_matrix(axes).as_euler("ZYX", degrees=True)
        centre = _fields("XYZABC", [*(parameters.com * 1e3), *angles])
        return (
            f"; {payload.remark}\n"
            f"$LOAD = {{M {parameters.mass:.9f}, CM {{{centre}}}, J {{{_fields('XYZ', moments.tolist())}}}}}\n"
        )


def _fields(names: str, values: list[float]) -> str:
    return ", ".join(f"{name} {value:.9f}" for name, value in zip(names, values, strict=True))
