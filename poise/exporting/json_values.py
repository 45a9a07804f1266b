"""JSON: the parameters with their covariance, by the names of `poise identify --json`."""

import json
from typing import Any

import numpy as np

from poise.exporting.base import ExportedPayload, Exporter


class JsonExporter(Exporter):
    """Everything the estimate says of the payload; null is what is not known."""

    kind = "json"
    summary = "JSON: mass, com, inertia, findings; covariance and bias, which are in the sensor frame"
    needs = ()
    physical = False
    doubtful = True

    def text(self, payload: ExportedPayload) -> str:
        """One object."""
        estimate = payload.estimate
        content = {
            "frame_id": payload.frame_id,
            "mass": payload.parameters.mass,
            "com": payload.parameters.com,
            "inertia": payload.six,
            "sensor_frame": estimate.frame_id,
            "covariance": estimate.covariance,
            "bias": estimate.bias,
            "method": estimate.method,
            "consistent": estimate.consistent,
            "unidentified": list(estimate.unidentified),
        }
        found = [
            {"code": int(each.code), "name": each.code.name, "sentence": each.message} for each in estimate.findings
        ]
        plain = {name: _plain(value) for name, value in content.items()} | {"findings": found}
        return json.dumps(plain, indent=2) + "\n"


def _plain(value: Any) -> Any:
    """Lists and numbers, None for what is not finite."""
    if isinstance(value, np.ndarray):
        return [_plain(entry) for entry in value]
    if isinstance(value, float):
        return float(value) if np.isfinite(value) else None
    return value
