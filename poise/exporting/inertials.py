"""Inertials as elements of XML, and numbers to full precision."""

import numpy as np

from poise.inertia import InertialParameters
from poise.types import Array

_AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


def numbers(values: Array) -> str:
    """Values with a space between, to full precision."""
    return " ".join(repr(float(value)) for value in np.ravel(values))


def urdf_inertial(parameters: InertialParameters) -> str:
    """The element of a link of a URDF; the inertia is about the centre of mass, in the link's axes."""
    six = numbers(parameters.inertia_vector).split()
    inertia = " ".join(f'{name}="{value}"' for name, value in zip(_AXES, six, strict=True))
    return f"""<inertial>
      <origin xyz="{numbers(parameters.com)}" rpy="0 0 0"/>
      <mass value="{parameters.mass!r}"/>
      <inertia {inertia}/>
    </inertial>"""


def mjcf_inertial(parameters: InertialParameters) -> str:
    """The element of a body of MJCF; `fullinertia` is about the centre of mass, in the order xx yy zz xy xz yz."""
    six = parameters.inertia_vector[[0, 3, 5, 1, 2, 4]]
    return f"""<inertial pos="{numbers(parameters.com)}" mass="{parameters.mass!r}"
                fullinertia="{numbers(six)}"/>"""


def sdf_inertial(parameters: InertialParameters) -> str:
    """The element of a link of SDFormat; its pose is the centre of mass, in the link's axes."""
    six = numbers(parameters.inertia_vector).split()
    inertia = "".join(f"<{name}>{value}</{name}>" for name, value in zip(_AXES, six, strict=True))
    return f"""<inertial>
        <pose>{numbers(parameters.com)} 0 0 0</pose>
        <mass>{parameters.mass!r}</mass>
        <inertia>{inertia}</inertia>
      </inertial>"""
