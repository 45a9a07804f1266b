"""Other names of joints, as a person gives them."""

from poise.errors import ErrorCode, InputError


def read_joint_names(text: str | None) -> dict[str, str]:
    """`new=old,...` -> names of the first recording by those of the second.

    Raises:
        InputError: BAD_INPUT for another form, or a name that is given twice.
    """
    pairs = [part.partition("=") for part in (text or "").split(",") if part.strip()]
    found = {own.strip(): other.strip() for own, _, other in pairs}
    named = [*found, *found.values()]
    if not all(named) or len(found) != len(pairs) or len(set(found.values())) != len(found):
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"--joints {text}: give pairs B=A with commas, each joint once: elbow=joint_3,wrist=joint_4",
        )
    return found
