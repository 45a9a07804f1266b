"""Declaration of parameters: descriptions, ranges, and one sentence for a value that is refused."""

from collections.abc import Collection, Sequence
from typing import Any, NamedTuple

from rcl_interfaces.msg import FloatingPointRange, IntegerRange, ParameterDescriptor
from rclpy.exceptions import InvalidParameterTypeException, InvalidParameterValueException
from rclpy.node import Node
from rclpy.parameter import Parameter as RosParameter

from poise.errors import ErrorCode, InputError

WORDS = RosParameter.Type.STRING_ARRAY
"""The default of a list of words, which has no typed empty one."""


class Parameter(NamedTuple):
    """One parameter.

    Args:
        name: of it. default: also its type. description: with unit.
        choices: the (least, greatest) number, or the words that are allowed.
        dynamic: a number in a range, or a switch, that may be changed while the node runs; it counts when next used.
    """

    name: str
    default: Any
    description: str
    choices: tuple[Any, ...] = ()
    dynamic: bool = False


AUTOSTART = Parameter("autostart", True, "configure and activate at start, for use without a lifecycle manager")
"""Of every managed node."""


def declare_parameters(node: Node, parameters: Sequence[Parameter], changeable: Collection[str] = ()) -> dict[str, Any]:
    """Declare `parameters`, and give their values by name; those of dynamic ones follow their changes.

    The others are read-only, but for the names in `changeable`, which the node has to follow itself.

    Raises:
        InputError: BAD_INPUT, for a value of the wrong type, out of its range or not among the words.
    """
    values = {one.name: _declare(node, one, one.dynamic or one.name in changeable) for one in parameters}
    dynamic = {one.name for one in parameters if one.dynamic}

    def follow(changed: Sequence[RosParameter]) -> None:
        values.update({one.name: one.value for one in changed if one.name in dynamic})

    if dynamic:
        node.add_post_set_parameters_callback(follow)
    return values


def one_of(parameter: Parameter, value: str) -> None:
    """Check a word against those that are allowed.

    Raises:
        InputError: BAD_INPUT.
    """
    if value not in parameter.choices:
        raise InputError(
            ErrorCode.BAD_INPUT, f"parameter {parameter.name} is {value!r}; use one of {', '.join(parameter.choices)}"
        )


def _declare(node: Node, parameter: Parameter, changeable: bool) -> Any:
    try:
        node.declare_parameter(parameter.name, parameter.default, _descriptor(parameter, changeable))
    except (InvalidParameterTypeException, InvalidParameterValueException) as error:
        kind = "list of words" if parameter.default is WORDS else type(parameter.default).__name__
        raise InputError(
            ErrorCode.BAD_INPUT,
            f"parameter {parameter.name} ({parameter.description}): {error}; it takes a {kind}{_constraint(parameter)}"
            " (write a float with a point, the word N in quotes)",
        ) from error
    value = node.get_parameter_or(parameter.name).value
    if parameter.default is WORDS:
        return list(value or [])
    if isinstance(parameter.default, str) and parameter.choices:
        one_of(parameter, value)
    return value


def _descriptor(parameter: Parameter, changeable: bool) -> ParameterDescriptor:
    descriptor = ParameterDescriptor(
        description=parameter.description, additional_constraints=_constraint(parameter), read_only=not changeable
    )
    if isinstance(parameter.default, float):
        least, greatest = parameter.choices
        descriptor.floating_point_range = [FloatingPointRange(from_value=least, to_value=greatest)]
    elif isinstance(parameter.default, int) and not isinstance(parameter.default, bool):
        least, greatest = parameter.choices
        descriptor.integer_range = [IntegerRange(from_value=least, to_value=greatest, step=1)]
    return descriptor


def _constraint(parameter: Parameter) -> str:
    if not parameter.choices:
        return ""
    if isinstance(parameter.default, str):
        return f", one of {', '.join(parameter.choices)}"
    return f" from {parameter.choices[0]} to {parameter.choices[1]}"
