"""A sentence about neighbours that count as touching across a gap, though poses seem to be better known than that."""

from poise.assembly.contact import Interface
from poise.assembly.scene import SceneFinding
from poise.assembly.statics import Analysis

_CLOSED, _NAMED = 2e-4, 3
"""m, of gaps and overlaps of what touches in exact poses: simulators let bodies overlap by hundredths of a mm."""


def gap_findings(analysis: Analysis) -> tuple[SceneFinding, ...]:
    """Contacts across gaps, of bodies that touch something else without a gap.

    Poses of scans leave gaps everywhere. Where those of a simulator or of a drawing leave some, bodies are apart there,
    but hold each other in all answers.
    """
    objects, interfaces = analysis.assembly.objects, analysis.structure.interfaces
    closed = {place for each in interfaces if abs(each.gap) <= _CLOSED for place in (each.first, each.second)}

    def known(each: Interface) -> bool:
        return all(objects[place].fixed or place in closed for place in (each.first, each.second))

    found = sorted((each for each in interfaces if each.gap > _CLOSED and known(each)), key=lambda each: -each.gap)
    if not found:
        return ()
    pairs = [f"{objects[each.first].id} and {objects[each.second].id} ({each.gap * 1e3:.2f} mm)" for each in found]
    more = f" and {len(found) - _NAMED} more" if len(found) > _NAMED else ""
    sentence = (
        f"{', '.join(pairs[:_NAMED])}{more} count as touching across gaps, and hold each other; if the poses are "
        "exact, give a smaller length to --touching; if a camera saw them, give pose_std"
    )
    return (SceneFinding(sentence, {"pairs": float(len(found)), "gap": found[0].gap}),)
