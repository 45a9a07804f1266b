"""Elements of a model by their names."""

from collections.abc import Sequence
from difflib import get_close_matches

from poise.errors import ErrorCode, InputError
from poise.exporting.models.xml_text import XmlElement


def found_by_name(elements: Sequence[XmlElement], kind: str, name: str, advice: str = "") -> XmlElement:
    """The one element of a kind with a name.

    Raises:
        InputError: BAD_INPUT when there is none, with names that look alike, or more than one.
    """
    named = [each for each in elements if each.name == kind]
    found = [each for each in named if each.attributes.get("name") == name]
    if len(found) == 1:
        return found[0]
    if found:
        raise InputError(ErrorCode.BAD_INPUT, f"the model has {len(found)} {kind}s named {name}")
    names = [each.attributes["name"] for each in named if "name" in each.attributes]
    near = get_close_matches(name, names, 3, 0.4) or names[:8]
    raise InputError(
        ErrorCode.BAD_INPUT, f"the model has no {kind} {name}; it has {', '.join(near) or 'none with a name'}{advice}"
    )
