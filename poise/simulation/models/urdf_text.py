"""Bodies and joints of a simulator's model as the text of a URDF."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal
from xml.sax.saxutils import quoteattr

import numpy as np
import pinocchio as pin

from poise.geometry import Pose
from poise.inertia.model import InertialParameters
from poise.types import Array

LinkMotion = Literal["fixed", "revolute", "continuous", "prismatic"]
_AXES = ("ixx", "ixy", "ixz", "iyy", "iyz", "izz")


@dataclass(frozen=True, eq=False)
class TreeJoint:
    """How a body moves in its parent.

    Args:
        name: of the joint.
        kind: of a URDF.
        axis: (3,) in the body's axes.
        lower, upper: rad or m; infinite for a continuous joint.
        follows: (joint, multiplier, offset) of a joint that this one follows, or None.
    """

    name: str
    kind: LinkMotion
    axis: Array
    lower: float = -np.inf
    upper: float = np.inf
    follows: tuple[str, float, float] | None = None


@dataclass(frozen=True, eq=False)
class TreeBody:
    """A link: its place in its parent where the joint is at zero; no parent: the root."""

    name: str
    parent: str | None
    pose: Pose
    joint: TreeJoint | None = None
    inertial: InertialParameters | None = None


def urdf_of(name: str, bodies: Sequence[TreeBody]) -> str:
    """The text of a URDF."""
    lines = [f"<robot name={quoteattr(name or 'robot')}>"]
    for body in bodies:
        lines += _link(body)
        if body.parent is not None:
            lines += _joint(body, body.parent)
    return "\n".join([*lines, "</robot>", ""])


def _link(body: TreeBody) -> list[str]:
    if body.inertial is None or body.inertial.mass <= 0.0:
        return [f"  <link name={quoteattr(body.name)}/>"]
    six = zip(_AXES, body.inertial.inertia_vector.tolist(), strict=True)
    moments = " ".join(f'{axis}="{value!r}"' for axis, value in six)
    return [
        f"  <link name={quoteattr(body.name)}><inertial>",
        f'    <origin xyz="{_numbers(body.inertial.com)}" rpy="0 0 0"/><mass value="{body.inertial.mass!r}"/>',
        f"    <inertia {moments}/>",
        "  </inertial></link>",
    ]


def _joint(body: TreeBody, parent: str) -> list[str]:
    joint = body.joint or TreeJoint(f"{body.name}__fixed", "fixed", np.array([0.0, 0.0, 1.0]))
    rpy = pin.rpy.matrixToRpy(body.pose.rotation)
    lines = [
        f'  <joint name={quoteattr(joint.name)} type="{joint.kind}">',
        f"    <parent link={quoteattr(parent)}/><child link={quoteattr(body.name)}/>",
        f'    <origin xyz="{_numbers(body.pose.translation)}" rpy="{_numbers(rpy)}"/>',
    ]
    if joint.kind != "fixed":
        lines.append(f'    <axis xyz="{_numbers(joint.axis)}"/>')
        if joint.kind != "continuous":
            lines.append(f'    <limit lower="{joint.lower!r}" upper="{joint.upper!r}" velocity="100" effort="1e5"/>')
        if joint.follows is not None:
            source, multiplier, offset = joint.follows
            lines.append(f'    <mimic joint={quoteattr(source)} multiplier="{multiplier!r}" offset="{offset!r}"/>')
    return [*lines, "  </joint>"]


def _numbers(values: Array) -> str:
    return " ".join(repr(float(value)) for value in values)
