"""Wrong descriptions of the robot: how it stands, lengths, masses, axes, units, what an exporter leaves out."""

from collections.abc import Callable
from dataclasses import replace
from xml.etree import ElementTree

import numpy as np
from scipy.spatial.transform import Rotation

from benchmarks.broken_inputs.way import Way, turning
from benchmarks.foreign.bag import Streams
from benchmarks.foreign.case import Case
from benchmarks.foreign.robots import Array

Element = ElementTree.Element
LINKS = "link_parameters"
MASSES = "masses of the description|correct the description"


def _description(change: Callable[[Element, Case], None]) -> Callable[[Case], Streams]:
    def broken(case: Case) -> Streams:
        robot = ElementTree.fromstring(case.streams.robot_description)
        change(robot, case)
        return replace(case.streams, robot_description=ElementTree.tostring(robot, encoding="unicode"))

    return broken


def _of_efforts(change: Callable[[Case], Streams | None]) -> Callable[[Case], Streams | None]:
    """Only where efforts are recorded: the wrench does not depend on the links."""
    return lambda case: change(case) if case.streams.joints.effort.size else None


def _joint(robot: Element, name: str) -> Element:
    return next(joint for joint in robot.findall("joint") if joint.get("name") == name)


def _numbers(element: Element, name: str) -> Array:
    return np.array((element.get(name) or "0 0 0").split(), dtype=float)


def _set(element: Element, name: str, values: Array) -> None:
    element.set(name, " ".join(repr(float(value)) for value in values))


def _origin(joint: Element) -> Element:
    found = joint.find("origin")
    return ElementTree.SubElement(joint, "origin") if found is None else found


def _turned(origin: Element, turn: Rotation, place: bool = False) -> None:
    """The origin with a turn before it (about its parent), or behind it."""
    own = Rotation.from_euler("xyz", _numbers(origin, "rpy"))
    _set(origin, "rpy", (turn * own if place else own * turn).as_euler("xyz"))
    if place:
        _set(origin, "xyz", turn.apply(_numbers(origin, "xyz")))


def _standing(*degrees: float) -> Callable[[Case], Streams]:
    """The robot on a wall, a ceiling or a ramp, of which the description does not know."""

    def change(robot: Element, case: Case) -> None:
        turn = Rotation.from_euler("xyz", degrees, degrees=True)
        children = {joint.find("child").get("link") for joint in robot.findall("joint")}  # type: ignore[union-attr]
        roots = {link.get("name") for link in robot.findall("link")} - children
        for joint in robot.findall("joint"):
            if joint.find("parent").get("link") in roots:  # type: ignore[union-attr]
                _turned(_origin(joint), turn, place=True)

    return _description(change)


def _lengths(factor: float, joints: slice = slice(None)) -> Callable[[Case], Streams]:
    def change(robot: Element, case: Case) -> None:
        for name in case.streams.names[joints]:
            origin = _origin(_joint(robot, name))
            _set(origin, "xyz", factor * _numbers(origin, "xyz"))

    return _description(change)


def _masses(mass: float, inertia: float) -> Callable[[Case], Streams]:
    def change(robot: Element, case: Case) -> None:
        for link in robot.iter("inertial"):
            for tag, factor in (("mass", mass), ("inertia", inertia)):
                for element in link.findall(tag):
                    for name, value in element.attrib.items():
                        element.set(name, repr(factor * float(value)))

    return _description(change)


def _without_inertials(robot: Element, case: Case) -> None:
    for link in robot.findall("link"):
        for inertial in link.findall("inertial"):
            link.remove(inertial)


def _centres_at_origins(robot: Element, case: Case) -> None:
    for inertial in robot.iter("inertial"):
        _set(_origin(inertial), "xyz", np.zeros(3))


def _axis(change: Callable[[Array], Array]) -> Callable[[Case], Streams]:
    """Of the last joint but one."""

    def changed(robot: Element, case: Case) -> None:
        for axis in _joint(robot, case.streams.names[-2]).findall("axis"):
            _set(axis, "xyz", change(_numbers(axis, "xyz")))

    return _description(changed)


def _angles_in_degrees(robot: Element, case: Case) -> None:
    for joint in robot.findall("joint"):
        origin = _origin(joint)
        _set(origin, "rpy", np.degrees(_numbers(origin, "rpy")))


def _sensor_turned(degrees: float) -> Callable[[Case], Streams | None]:
    """The flange: the joint that carries the sensor's frame is turned about the axis of the last joint."""

    def change(robot: Element, case: Case) -> None:
        frame = case.model["sensor_frame"]
        joint = next(each for each in robot.findall("joint") if each.find("child").get("link") == frame)  # type: ignore[union-attr]
        _turned(_origin(joint), Rotation.from_euler("z", degrees, degrees=True), place=True)

    return lambda case: None if case.streams.wrench is None else _description(change)(case)


def _other_kind(robot: Element, case: Case) -> None:
    joint = _joint(robot, case.streams.names[-2])
    joint.set("type", "prismatic" if joint.get("type") != "prismatic" else "revolute")


def _without_limits(robot: Element, case: Case) -> None:
    for joint in robot.findall("joint"):
        for limit in joint.findall("limit"):
            limit.set("lower", "-100")
            limit.set("upper", "100")


WAYS = {
    "on a ceiling": Way(_standing(180.0, 0.0, 0.0), "base is turned|upside down"),
    "on a wall": Way(_standing(90.0, 0.0, 0.0), "base is turned"),
    "on a ramp of 5 degrees": Way(_standing(5.0, 0.0, 0.0), "", "base_tilt"),
    "links a tenth shorter": Way(_lengths(0.9), "", LINKS, harmless=True),
    "a forearm too long": Way(_lengths(1.2, slice(2, 3)), "", LINKS, harmless=True),
    "lengths in mm": Way(_lengths(1000.0), "in mm"),
    "masses in g": Way(_of_efforts(_masses(1000.0, 1000.0)), MASSES),
    "masses in lb": Way(_of_efforts(_masses(2.2046226, 2.2046226)), MASSES, LINKS),
    "a thousandth of the mass": Way(_of_efforts(_masses(1e-3, 1e-3)), MASSES, LINKS),
    "inertias in kg cm2": Way(_of_efforts(_masses(1.0, 1e4)), "inertia"),
    "no inertials": Way(_of_efforts(_description(_without_inertials)), MASSES, LINKS),
    "centres of mass at origins": Way(_of_efforts(turning(_description(_centres_at_origins))), "", LINKS),
    "an axis reversed": Way(turning(_axis(np.negative)), "opposite direction|its range in the description"),
    "another axis": Way(_axis(lambda axis: np.roll(axis, 1)), "turned about"),
    "angles in degrees": Way(_description(_angles_in_degrees), "degrees"),
    "flange turned by 45 degrees": Way(_sensor_turned(45.0), "zero of", "sensor_rotation"),
    "flange turned by 180 degrees": Way(_sensor_turned(180.0), "zero of", "sensor_rotation"),
    "a slide for a turn": Way(_description(_other_kind), "turned about|of this robot", LINKS),
    "no limits": Way(_description(_without_limits), "", harmless=True),
}
