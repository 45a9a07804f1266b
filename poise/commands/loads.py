"""`poise msa --load ID --model model.yaml`: one object of a scene weighs what a diagnosis says that it weighs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from poise.assembly import Analysis, acceleration_limits
from poise.assembly.robustness import AccelerationLimits
from poise.errors import ErrorCode, InputError, NoAnswerError
from poise.geometry import Pose
from poise.mismatch.application import loads_about
from poise.mismatch.reading import load_model
from poise.types import Array, Mask

LoadOption = Annotated[
    str | None,
    typer.Option(
        "--load", metavar="ID", help="Object of the scene that gets the payload of --model.", show_default=False
    ),
]
LoadModelOption = Annotated[
    Path | None,
    typer.Option("--model", metavar="FILE", help="model.yaml, as poise mismatch --save writes it.", show_default=False),
]
LoadPoseOption = Annotated[
    str | None,
    typer.Option(
        "--load-pose",
        metavar="'X Y Z QX QY QZ QW'",
        help="Pose of that object's frame in the sensor frame, m and a unit quaternion (default: the same frame).",
        show_default=False,
    ),
]


def loaded(
    analysis: Analysis, load: str | None, model: Path | None, pose: str | None
) -> tuple[Analysis, list[Analysis]]:
    """The scene with the object as the model knows it, and the scenes with all that it may be besides.

    Raises:
        InputError: BAD_INPUT for half of the options; OBJECT_UNKNOWN; as `load_model` and `loads_about`.
    """
    if load is None and model is None and pose is None:
        return analysis, []
    if load is None or model is None:
        raise InputError(
            ErrorCode.BAD_INPUT, "--load and --model belong together: give the object's id and the model of its payload"
        )
    assembly = analysis.assembly
    item = assembly.objects[assembly.place_of(load)]
    made = loads_about(item, load_model(model), _pose(pose))
    first, *others = [analysis.with_object(each) for each in made]
    return first, others


def least_limits(found: AccelerationLimits, others: Sequence[Analysis], deadline: float | None) -> tuple[Array, Mask]:
    """Least limits (D,) of a scene and of others like it, 0 where one does not stand; whether one is doubtful (D,)."""
    least, doubtful = np.array(found.limits, dtype=np.float64), found.doubtful.copy()
    for other in others:
        try:
            limits = acceleration_limits(other, found.directions, deadline, turning=False)
            least, doubtful = np.minimum(least, limits.limits), doubtful | limits.doubtful
        except NoAnswerError as error:
            if error.code is not ErrorCode.UNSTABLE:
                raise
            least = np.zeros_like(least)
    return least, doubtful


def _pose(text: str | None) -> Pose:
    if text is None:
        return Pose(np.eye(3), np.zeros(3))
    try:
        numbers = [float(word) for word in text.replace(",", " ").split()]
    except ValueError:
        numbers = []
    if len(numbers) != 7 or not np.linalg.norm(numbers[3:]) > 0:
        raise InputError(ErrorCode.BAD_INPUT, f"--load-pose '{text}': give seven numbers, x y z qx qy qz qw")
    return Pose.from_vector(numbers)
