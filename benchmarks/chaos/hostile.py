"""Messages with hostile values, made from the definition of any message, service or action."""

import array
import math
import random
from importlib import import_module
from typing import Any

_FLOATS = (math.nan, math.inf, -math.inf, 1e300, -1e300, 1e155, 5e-324, -1.0, -1e-9, 0.0, 1.0, 1e9)
_WORDS = (
    "",
    "world",
    "tray",
    "cube",
    "floor",
    "ft_sensor",
    "../../etc/passwd",
    "\x00",
    "é" * 300,
    "a" * 5000,
    "{}",
    "%s",
)
_URIS = (
    "package://poise/../../etc/passwd",
    "file:///etc/passwd",
    "file:///dev/zero",
    "http://localhost/a",
    "package://",
)
_COUNTS = (0, 0, 1, 1, 2, 3, 17)
_DEEPEST = 8


def message_type(name: str) -> Any:
    """The class of an interface such as `geometry_msgs/msg/WrenchStamped`."""
    package, kind, word = name.split("/")
    return getattr(import_module(f"{package}.{kind}"), word)


def hostile(kind: Any, rng: random.Random, depth: int = 0) -> Any:
    """A message whose fields are each hostile, or left as they are by default.

    Args:
        kind: class of the message (of a service's request, of an action's goal).
        rng: source of randomness.
    """
    message = kind()
    for field, type_name in kind.get_fields_and_field_types().items():
        if rng.random() < 0.3 and depth:
            continue
        setattr(message, field, _value(type_name, rng, depth))
    return message


def spoiled(message: Any, rng: random.Random, count: int = 1) -> Any:
    """A sound message with `count` numbers, texts or arrays in it replaced by hostile ones.

    Args:
        message: is changed, and returned.
        rng: source of randomness.
        count: of replacements.
    """
    for _ in range(count):
        _spoil(message, rng)
    return message


def _spoil(message: Any, rng: random.Random) -> None:
    fields = list(message.get_fields_and_field_types().items())
    if not fields:
        return
    field, type_name = rng.choice(fields)
    value = getattr(message, field)
    if hasattr(value, "get_fields_and_field_types") and rng.random() < 0.9:
        _spoil(value, rng)
    elif isinstance(value, list) and value and hasattr(value[0], "get_fields_and_field_types") and rng.random() < 0.8:
        _spoil(rng.choice(value), rng)
    elif not isinstance(value, str) and hasattr(value, "__len__") and len(value) and rng.random() < 0.6:
        values = list(value)
        element = type_name.removeprefix("sequence<").split(",")[0].rstrip(">").partition("[")[0]
        values[rng.randrange(len(values))] = _value(element, rng, 1)
        setattr(message, field, values)
    else:
        setattr(message, field, _value(type_name, rng, 1))


def _value(type_name: str, rng: random.Random, depth: int) -> Any:
    if type_name.startswith("sequence<"):
        inner, _, bound = type_name.removeprefix("sequence<").removesuffix(">").partition(", ")
        count = min(rng.choice(_COUNTS), int(bound) if bound else 1 << 30)
        return _several(inner, 0 if depth > _DEEPEST else count, rng, depth)
    if type_name.endswith("]"):
        inner, _, count = type_name.removesuffix("]").partition("[")
        return _several(inner, int(count), rng, depth)
    return _single(type_name, rng, depth)


def _several(inner: str, count: int, rng: random.Random, depth: int) -> Any:
    if inner in ("octet", "uint8", "byte"):
        return [rng.randrange(256) for _ in range(count)] if inner != "octet" else [bytes([7])] * count
    return [_single(inner, rng, depth + 1) for _ in range(count)]


def _single(type_name: str, rng: random.Random, depth: int) -> Any:
    if type_name in ("double", "float", "float64", "float32"):
        value = rng.choice(_FLOATS) if rng.random() < 0.7 else rng.gauss(0.0, 1.0)
        narrow = type_name in ("float", "float32") and math.isfinite(value)
        return max(-3e38, min(3e38, value)) if narrow else value
    if type_name.startswith(("uint", "int")):
        bits = int(type_name.lstrip("uint"))
        least, most = (0, 2**bits - 1) if type_name.startswith("uint") else (-(2 ** (bits - 1)), 2 ** (bits - 1) - 1)
        return rng.choice((least, most, 0, 1, min(most, 3), min(most, 100_001)))
    if type_name.startswith(("string", "wstring")):
        return rng.choice(_WORDS + _URIS)
    if type_name in ("boolean", "bool"):
        return rng.random() < 0.5
    if type_name in ("octet", "byte"):
        return bytes([rng.randrange(256)])
    if "/" not in type_name:
        raise TypeError(f"no hostile value for {type_name}")
    package, _, name = type_name.partition("/")
    return hostile(message_type(f"{package}/msg/{name}"), rng, depth + 1)


def numbers_of(message: Any, path: str = "") -> dict[str, float]:
    """Every floating-point number in a message, by its path."""
    found: dict[str, float] = {}
    for field in message.get_fields_and_field_types():
        value = getattr(message, field)
        where = f"{path}.{field}" if path else field
        if isinstance(value, float):
            found[where] = value
        elif hasattr(value, "get_fields_and_field_types"):
            found |= numbers_of(value, where)
        elif isinstance(value, array.array) and value.typecode in "fd":
            found |= {f"{where}[{i}]": number for i, number in enumerate(value)}
        elif isinstance(value, list | tuple):
            for i, item in enumerate(value):
                if isinstance(item, float):
                    found[f"{where}[{i}]"] = item
                elif hasattr(item, "get_fields_and_field_types"):
                    found |= numbers_of(item, f"{where}[{i}]")
    return found
