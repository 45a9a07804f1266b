"""The modular test object of thesis section 3.1.4: a printed plate with holes, filled with weights in eight patterns.

Figures 3.2 and 3.3 show a printed PLA structure whose holes take steel weights of 101 g and ABS weights of 17 g; their
sizes and the patterns are not in the text, only 56 points at 0.04 points/cm3 (1400 cm3), the masses, and two of the
names (Hammer, Tee). Chosen here: a plate of 260 x 180 x 30 mm (1404 cm3) with 5 x 3 holes, and the patterns below.
"""

import functools
from dataclasses import dataclass

import numpy as np

from benchmarks.identification.objects import BenchmarkObject
from poise.inertia.model.parameters import InertialParameters, frame_change
from poise.types import Array

PLATE = np.array([0.26, 0.18, 0.03])  # m
PLATE_DENSITY = 300.0  # kg/m3: PLA, printed with a quarter of infill
HOLES = [(0.05 * (column - 2), 0.055 * (row - 1)) for row in (2, 1, 0) for column in range(5)]  # m, as in a pattern
HOLE_RADIUS = 0.016  # m, right through the plate
PLATE_IN_SENSOR = np.array([0.06, 0.0, 0.045])  # m: held beside its centre, on an adapter


@dataclass(frozen=True)
class Weight:
    """A cylinder that fits a hole."""

    mass: float
    length: float


# Solid cylinders of steel (7850 kg/m3) and ABS (1046 kg/m3) with these masses (thesis fig. 3.3) are this long.
WEIGHTS = {"S": Weight(0.101, 0.016), "a": Weight(0.017, 0.0202)}

# Hole by hole, seen from above: S steel, a ABS, . empty.
PATTERNS: dict[str, tuple[str, str, str]] = {
    "Hammer": ("....S", "aaaaS", "....S"),
    "Tee": ("S....", "SSSSS", "S...."),
    "Barbell": ("S...S", "SaaaS", "S...S"),
    "Corners": ("SaaaS", "aaaaa", "SaaaS"),
    "Half & half": ("SSaaa", "SSaaa", "SSaaa"),
    "Rod": (".....", "SSSSS", "....."),
    "Homogeneous": ("aaaaa", "aaaaa", "aaaaa"),
    "Corner": ("SSaaa", "SSaaa", "aaaaa"),
}


@functools.cache
def modular_objects() -> tuple[BenchmarkObject, ...]:
    """The eight configurations, with exact parameters and each body (plate, every weight) as a part."""
    return tuple(configuration(name, "".join(rows)) for name, rows in PATTERNS.items())


def configuration(name: str, pattern: str) -> BenchmarkObject:
    """The plate with its holes filled as 15 letters say."""
    hole_area = np.pi * HOLE_RADIUS**2
    plate = box(PLATE_DENSITY * np.prod(PLATE), PLATE)
    hole = cylinder(PLATE_DENSITY * hole_area * PLATE[2], HOLE_RADIUS, PLATE[2])
    for x, y in HOLES:
        plate = plate - hole.in_frame(np.eye(3), [x, y, 0.0])
    bodies = [plate]
    volumes = [float(np.prod(PLATE) - len(HOLES) * hole_area * PLATE[2])]
    for letter, (x, y) in zip(pattern, HOLES, strict=True):
        if letter != ".":
            weight = WEIGHTS[letter]
            bodies.append(cylinder(weight.mass, HOLE_RADIUS, weight.length).in_frame(np.eye(3), [x, y, 0.0]))
            volumes.append(float(hole_area * weight.length))
    into_sensor = frame_change(np.eye(3), PLATE_IN_SENSOR)
    corners = np.array(np.meshgrid(*([-0.5, 0.5],) * 3)).reshape(3, -1).T * PLATE
    # Point masses may sit anywhere in the outline of the plate: what fills its holes is not known to the shape.
    points = (np.random.default_rng(0).random((2000, 3)) - 0.5) * PLATE
    return BenchmarkObject(
        name=name,
        truth=InertialParameters.from_phi(into_sensor @ sum(body.phi for body in bodies)),
        bounding_box=PLATE,
        hull=corners + PLATE_IN_SENSOR,
        unit_parts=into_sensor @ np.stack([body.phi / body.mass for body in bodies], axis=1),
        part_volumes=np.array(volumes),
        points=points + PLATE_IN_SENSOR,
    )


def box(mass: float, sides: Array) -> InertialParameters:
    """A solid box about its centre."""
    return InertialParameters(mass, np.zeros(3), np.diag(mass / 12 * (sides @ sides - sides**2)))


def cylinder(mass: float, radius: float, length: float) -> InertialParameters:
    """A solid cylinder about its centre, along z."""
    across = mass * (3 * radius**2 + length**2) / 12
    return InertialParameters(mass, np.zeros(3), np.diag([across, across, mass * radius**2 / 2]))
