"""An assembly as it was seen, settled until things touch, and analysed; what is answered about it has intervals."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from poise.assembly import Analysis, Assembly, Push, Settled, assess, assess_settled, settle
from poise.assembly.robustness import Assessment, UncertainAssessment, carried
from poise.assembly.scene import pose_covariance_of, with_pose_covariance
from poise.assembly.statics import Deadline, analysis_after, surface_distance
from poise.nodes.assembly_message import notes_of
from poise.types import Array


class PoseDoubt(NamedTuple):
    """What a node assumes about poses, from its parameters.

    Args:
        position, rotation_deg: one sigma of each coordinate, m, and of each angle, degrees, of poses that give none.
        samples: draws of what is uncertain, for intervals.
    """

    position: float = 0.0
    rotation_deg: float = 0.0
    samples: int = 0

    @property
    def covariance(self) -> Array:
        """(6, 6) of a pose."""
        return pose_covariance_of(self.position, float(np.radians(self.rotation_deg)))

    def applied(self, assembly: Assembly) -> Assembly:
        """The assembly with this uncertainty for poses that give none; the same where there is none."""
        if not (self.position or self.rotation_deg):
            return assembly
        return replace(assembly, objects=with_pose_covariance(assembly.objects, self.covariance))


@dataclass(frozen=True, eq=False)
class PerceivedScene:
    """An assembly as it was seen, and its analysis at the settled poses.

    Args:
        settled: without moves where no pose is uncertain.
        analysis: of the settled assembly.
    """

    settled: Settled
    analysis: Analysis

    @classmethod
    def after(cls, before: "PerceivedScene | None", seen: Assembly, related: bool = True) -> "PerceivedScene":
        """Settle and analyse; what is unchanged since another scene is not computed again.

        Args:
            before: another scene.
            seen: the assembly.
            related: the other one was an earlier view of the same scene, whose contacts stay if they explain this one.

        Raises:
            InputError: as `settle` and `Analysis.of`.
        """
        settled = settle(seen, before.settled.assembly if before is not None and related else None)
        return cls(settled, analysis_after(None if before is None else before.analysis, settled.assembly))

    @classmethod
    def restored(cls, before: "PerceivedScene | None", seen: Assembly, assembly: Assembly) -> "PerceivedScene":
        """The scene that another process has settled as `assembly`."""
        found = replace(settle(seen, assembly), assembly=assembly)
        return cls(found, analysis_after(None if before is None else before.analysis, assembly))

    @property
    def seen(self) -> Assembly:
        """The objects where they were seen."""
        return self.settled.seen

    @property
    def uncertain(self) -> bool:
        """Poses were settled."""
        return bool(self.settled.moves)

    def notes(self, deadline: Deadline) -> list[str]:
        """What was assumed, and what was moved, one sentence each."""
        return [*notes_of(self.analysis, deadline), *self.settled.sentences]

    def answered(
        self, pushes: Sequence[Push | Sequence[Push]], model: str, deadline: float, samples: int
    ) -> tuple[Assessment, list[tuple[float, float]], list[str]]:
        """The answer at the settled poses, the interval of each push, N, and what to read these with.

        Raises:
            InputError, NoAnswerError: as `assess`.
        """
        if not self.uncertain:
            found = assess(self.analysis, pushes, model, deadline)
            return found, [(result.lower, result.upper) for result in found.results], []
        wanted = samples if pushes else 0
        drawn = assess_settled(self.settled, self._as_seen(pushes), model, deadline, wanted, analysis=self.analysis)
        intervals = list(zip(drawn.lower.tolist(), drawn.upper.tolist(), strict=True))
        return drawn.settled, intervals, _sentences(drawn, wanted)

    def _as_seen(self, pushes: Sequence[Push | Sequence[Push]]) -> list[Push | list[Push]]:
        """Pushes with points on the objects as they were seen, whose points are on these or on the settled ones."""
        there = carried(pushes, self.settled.assembly, self.seen)
        found: list[Push | list[Push]] = []
        for given, back in zip(pushes, there, strict=True):
            if isinstance(given, Push) or isinstance(back, Push):
                found.append(self._nearer(given, back))  # type: ignore[arg-type]
            else:
                found.append([self._nearer(*pair) for pair in zip(given, back, strict=True)])
        return found

    def _nearer(self, given: Push, back: Push) -> Push:
        """Of a push as given and its point taken back from the settled object: the one on the object as seen."""
        place = self.seen.index.get(given.object)
        if place is None:
            return given
        points = np.array([given.point, back.point], dtype=np.float64).reshape(2, 3)
        off = np.abs(surface_distance(self.seen.objects[place], points))
        return given if off[0] <= off[1] + _SAME else back


_SAME = 1e-6
"""m: points that are as near a surface."""


def _sentences(drawn: UncertainAssessment, wanted: int) -> list[str]:
    if not wanted or not drawn.settled.stable:
        return []
    tried = drawn.samples + drawn.fallen + drawn.refused
    late = "" if tried == wanted else f" (of {wanted}: the deadline passed)"
    left_out = drawn.fallen + drawn.refused
    others = f"; {left_out} more that do not stand or could not be answered are left out" if left_out else ""
    return [
        f"interval_lower and interval_upper are over {drawn.samples} draws of what is uncertain{late}: a further one "
        f"is inside with {drawn.coverage:.0%}{others}",
        *([drawn.reservation] if drawn.reservation else []),
    ]
