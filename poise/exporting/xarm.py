"""UFACTORY xArm: a line for the Python SDK (xArm-Python-SDK, `XArmAPI.set_tcp_load`)."""

from poise.exporting.base import ExportedPayload, Exporter


class XarmExporter(Exporter):
    """`set_tcp_load(weight, center_of_gravity)`: kg, and mm in the flange frame; there is no inertia."""

    kind = "xarm"
    summary = "xArm: set_tcp_load of the Python SDK"
    needs = ("mass", "com")
    omits = ("inertia",)
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """The call on an `arm` of the SDK."""
        com = [float(value) for value in payload.parameters.com * 1e3]
        return f"# {payload.remark}\narm.set_tcp_load({payload.parameters.mass!r}, {com!r})\n"
