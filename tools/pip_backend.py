"""Build backend for pip and uv: setuptools, with the ROS interface generators only where the nodes are installed."""

import os
import tomllib
from pathlib import Path
from typing import Any

from setuptools import build_meta
from setuptools.build_meta import *  # noqa: F403  the hooks of PEP 517


def get_requires_for_build_wheel(config_settings: dict[str, Any] | None = None) -> list[str]:
    """The requirements of setuptools, and of the interfaces unless POISE_CORE=1."""
    wanted: list[str] = build_meta.get_requires_for_build_wheel(config_settings)
    if os.environ.get("POISE_CORE", "0") not in ("", "0"):
        return wanted
    settings = tomllib.loads((Path(__file__).parents[1] / "pyproject.toml").read_text(encoding="utf-8"))
    return wanted + settings["tool"]["poise"]["interface-build-requires"]
