"""Universal Robots: a line of URScript (script manual, `set_target_payload`, e-Series software 5.10 and later)."""

from poise.exporting.base import ExportedPayload, Exporter, decimals


class UrExporter(Exporter):
    """`set_target_payload(m, cog, inertia)`: kg; m from the tool mount; kg m2 about the centre of gravity, in the axes
    of the tool flange, in the order Ixx Iyy Izz Ixy Ixz Iyz. The robot zeroes its own force sensor when it runs.
    """

    kind = "ur"
    summary = "URScript: set_target_payload"
    needs = ("mass", "com")
    flange = True

    def text(self, payload: ExportedPayload) -> str:
        """The line; without the inertia where it was not identified (the robot then takes zero)."""
        arguments = [f"{payload.parameters.mass:.9f}", f"[{decimals(payload.parameters.com)}]"]
        remark = payload.remark
        if payload.has_inertia:
            arguments.append(f"[{decimals(payload.six[[0, 3, 5, 1, 2, 4]])}]")
        else:
            remark += "; the inertia was not identified"
        return f"# {remark}\nset_target_payload({', '.join(arguments)})\n"
