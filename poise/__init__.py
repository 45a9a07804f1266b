"""Poise: weigh the object that a robot holds, compute how hard a stack can be pushed, place the next object.

The functions below load their room on first use, so `import poise` is fast. The rooms (`poise.inertia`,
`poise.assembly`, ...) have more functions. Only `poise.nodes` and `poise.fake_robots` import ROS.

Example:
    >>> import poise
    >>> poise.identify("bags/kuka_static_poses.mcap")
"""

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from poise.api import diagnose, identify, place, read, robustness, scan, segment

__version__ = "0.2.0"
__all__ = ["compare", "diagnose", "identify", "place", "read", "robustness", "scan", "segment"]


def __getattr__(name: str) -> Any:
    """Load a function of the short interface on first use (PEP 562)."""
    if name not in __all__:
        raise AttributeError(f"module 'poise' has no attribute {name!r}")
    from poise import api

    globals()[name] = getattr(api, name)
    return globals()[name]


def __dir__() -> list[str]:
    return sorted([*globals(), *__all__])
