"""Ground floor: rigid poses, rotations, vectors and gravity, used by every room.

- `pose`: `Pose`, the rigid pose of a frame in its parent.
- `rotations`: rotation matrices from and to quaternions, about an axis, between two vectors.
- `rows`: order of the rows of arrays, distinct rows and numbers, rows that are used.
- `vectors`: unit vectors, directions over the sphere, lengths, axes in a plane, products, wrenches of forces.
- `gravity`: the standard acceleration, and the default gravity vector.
"""

from poise.geometry.gravity import GRAVITY_IN_WORLD, STANDARD_GRAVITY
from poise.geometry.pose import Pose
from poise.geometry.rotations import (
    are_rotations,
    cross_matrix,
    nearest_rotation,
    quaternion_of_rotation,
    rotation_about,
    rotation_between,
    rotation_of_quaternion,
    rotation_of_vector,
    vector_of_rotation,
)
from poise.geometry.rows import distinct_numbers, row_order, runs, unique_rows, used_rows
from poise.geometry.vectors import (
    applied,
    cross,
    lengths,
    move_wrench,
    plane_axes,
    sphere_directions,
    unit,
    wrench_of_force,
)

__all__ = [
    "GRAVITY_IN_WORLD",
    "STANDARD_GRAVITY",
    "Pose",
    "applied",
    "are_rotations",
    "cross",
    "cross_matrix",
    "distinct_numbers",
    "lengths",
    "move_wrench",
    "nearest_rotation",
    "plane_axes",
    "quaternion_of_rotation",
    "rotation_about",
    "rotation_between",
    "rotation_of_quaternion",
    "rotation_of_vector",
    "row_order",
    "runs",
    "sphere_directions",
    "unique_rows",
    "unit",
    "used_rows",
    "vector_of_rotation",
    "wrench_of_force",
]
