"""Robots of a few lines for tests: links, joints and the <robot> around them."""


def link(name, mass=None, at="0 0 0"):
    if mass is None:
        return f'<link name="{name}"/>'
    return (
        f'<link name="{name}"><inertial><origin xyz="{at}"/><mass value="{mass}"/>'
        '<inertia ixx="0.1" iyy="0.1" izz="0.1" ixy="0" ixz="0" iyz="0"/></inertial></link>'
    )


def joint(name, kind, parent, child, inside="", at="0 0 0"):
    limit = '<limit lower="-1" upper="2" velocity="3" effort="4"/>' if kind in ("revolute", "prismatic") else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="{at}"/><axis xyz="0 0 1"/>{limit}{inside}</joint>'
    )


def robot(*parts):
    return f'<robot name="r">{"".join(parts)}</robot>'
