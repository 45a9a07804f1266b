"""The process behind robustness_server: requests in, responses out, both serialized; the analysis stays warm.

It holds one assembly, and the next one between its computation and the decision of the server. Each has a key that
the server gives to no other assembly, also not to one that was refused.
"""

import contextlib
import time
import traceback
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from geometry_msgs.msg import Vector3
from rclpy.serialization import deserialize_message, serialize_message
from visualization_msgs.msg import MarkerArray

from poise.assembly import plan_disassembly, robustness_map
from poise.assembly.robustness import Robustness, RobustnessMap
from poise.assembly.statics import Deadline, unstable
from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import Pose
from poise.nodes.answer_checks import check_answer
from poise.nodes.assembly_changes import changed, late, not_checked, stability_of
from poise.nodes.assembly_markers import map_markers, mechanism_markers, scene_markers
from poise.nodes.assembly_message import (
    assembly_message,
    assembly_of,
    pushes_of,
    robustness_message,
)
from poise.nodes.map_message import map_message
from poise.nodes.perceived_scene import PerceivedScene, PoseDoubt
from poise.nodes.runtime import coded
from poise.nodes.workers import Exchange, Header
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.srv import AssessRobustness, PlanDisassembly, SetAssembly

MAP_TOLERANCE = 0.03
"""Of the bounds of a map, unless the request gives one."""
_MARKER_SECONDS = 2.0
"""s that the map of the markers may take."""
_KINDS = {"assess": AssessRobustness, "plan": PlanDisassembly, "set": SetAssembly, "move": SetAssembly}


class RobustnessWorker:
    """Answers exchanges about the assembly whose key their header has.

    Args:
        folders: in which meshes may lie.
        marker_map_points: of the map in the markers.
        doubt: what is assumed about poses: the arguments of `PoseDoubt`.
    """

    def __init__(self, folders: Sequence[str], marker_map_points: int, doubt: Sequence[Any] = ()) -> None:
        self._doubt = PoseDoubt(*doubt)
        self._folders = tuple(Path(folder) for folder in folders)
        self._marker_map_points = marker_map_points
        self._key = 0
        self._scene: PerceivedScene | None = None
        self._next: tuple[int, PerceivedScene] | None = None
        self._recent: PerceivedScene | None = None
        self._results: Sequence[Robustness] = ()
        self._map: RobustnessMap | None = None
        self._work: dict[str, Callable[..., None]] = {"assess": self._assess, "plan": self._plan, "set": self._set}

    def __call__(self, header: Header, messages: list[bytes]) -> Exchange:
        """Answer one exchange; an error becomes that of the response, or `error` of the header where there is none."""
        work = header["do"]
        kind = _KINDS[work].Response if work in _KINDS else MarkerArray
        response = kind()
        answer: Header = {}
        extra: list[bytes] = []
        known: PoiseError | None = None
        try:
            self._do(header, messages, response, extra)
        except PoiseError as error:
            known = error
        except MemoryError:
            what = "this call needs more memory than worker_memory: ask for less at once"
            known, response, extra = InputError(ErrorCode.BAD_INPUT, what), kind(), []
        except Exception as error:
            answer["log"] = traceback.format_exc()
            known, response, extra = coded(error), kind(), []
        if work in _KINDS:
            if known is not None:
                response.error.code, response.error.message = int(known.code), known.message
            try:
                check_answer(response)
            except PoiseError as error:
                response, extra, self._next = kind(), [], None
                response.error.code, response.error.message = int(error.code), error.message
                answer["log"] = error.message
        elif known is not None:
            answer["error"] = [int(known.code), known.message]
        return answer, [serialize_message(response), *extra]

    def _do(self, header: Header, messages: list[bytes], response: Any, extra: list[bytes]) -> None:
        work = header["do"]
        if work == "hold":
            self._hold(header, messages)
            return
        self._choose(header["key"])
        if work == "draw":
            response.markers = self._markers(header)
        elif work == "move":
            self._move(header, response, extra)
        else:
            request = deserialize_message(messages[0], _KINDS[work].Request)
            self._work[work](request, response, header, extra)

    def _choose(self, key: int) -> None:
        """Of the present assembly and the one that was proposed last, keep the one that has this key.

        Raises:
            PoiseError: INTERNAL when none of them has: no answer about another assembly.
        """
        if self._next is not None and self._next[0] == key:
            self._keep(*self._next)
        self._next = None
        if self._key != key:
            raise PoiseError(ErrorCode.INTERNAL, f"asked about assembly {key}, but this worker has {self._key}")

    def _hold(self, header: Header, messages: list[bytes]) -> None:
        """Have the assembly that messages bring, settled and as it was seen, and know whether it stands."""
        assembly, *seen = [
            assembly_of(deserialize_message(message, AssemblyMessage), self._folders) for message in messages if message
        ]
        scene = (
            PerceivedScene.restored(self._scene, seen[0], assembly)
            if seen
            else PerceivedScene.after(self._scene, assembly)
        )
        scene.analysis.stability(Deadline(header["deadline"]))
        self._keep(header["key"], scene)

    def _keep(self, key: int, scene: PerceivedScene) -> None:
        self._key, self._scene, self._next = key, scene, None
        self._results, self._map = (), None

    def _assess(
        self, request: AssessRobustness.Request, response: AssessRobustness.Response, header: Header, _: list[bytes]
    ) -> None:
        pushes = pushes_of(request.pushes, request.groups)
        start, deadline = time.perf_counter(), header["deadline"]
        scene = self._scene_for(request)
        analysis, left = scene.analysis, max(deadline - time.monotonic(), 0.0)
        found, intervals, notes = scene.answered(pushes, request.model, left, self._doubt.samples)
        response.assumptions = [*scene.notes(Deadline(deadline)), *notes]
        complete, mapped = found.complete, None
        if request.map_points and found.stable:
            tolerance = request.map_tolerance or MAP_TOLERANCE
            left = max(deadline - time.monotonic(), 0.0)
            mapped = robustness_map(analysis, request.map_points, tolerance, request.model, left)
            complete &= mapped.complete
        for result in found.results:
            _ = result.mode, result.mechanism  # computed when first used: part of the computation, too
        response.seconds = time.perf_counter() - start
        response.stable, response.margin, response.falling = found.stable, found.margin, list(found.falling)
        response.robustness = [robustness_message(*each) for each in zip(found.results, intervals, strict=True)]
        if mapped is not None:
            response.map = [map_message(mapped, _stamped(AssemblyMessage(), header).header)]
        if not request.assembly and found.stable:
            self._results, self._map = found.results or self._results, mapped or self._map
        if not (found.stable or found.doubtful):
            raise unstable(found.falling, found.margin)
        if not complete:
            raise late("the bounds are what was certified by then")

    def _plan(
        self, request: PlanDisassembly.Request, response: PlanDisassembly.Response, header: Header, _: list[bytes]
    ) -> None:
        start = time.perf_counter()
        scene = self._scene_for(request)
        left = max(header["deadline"] - time.monotonic(), 0.0)
        found = plan_disassembly(scene.analysis, request.target or None, left)
        response.seconds = time.perf_counter() - start
        response.assumptions = scene.notes(Deadline(header["deadline"]))
        response.order, response.safe, response.margins = list(found.order), list(found.safe), list(found.margins)
        ways = [np.zeros(3) if way is None else way for way in found.ways]
        response.ways = [Vector3(x=x, y=y, z=z) for x, y, z in np.reshape(ways, (-1, 3)).tolist()]
        if not found.complete:
            raise late("what is not marked safe was not looked into")

    def _set(
        self, request: SetAssembly.Request, response: SetAssembly.Response, header: Header, extra: list[bytes]
    ) -> None:
        before = None if self._scene is None else self._scene.seen
        seen = self._doubt.applied(changed(before, request, self._folders))
        self._propose(PerceivedScene.after(self._scene, seen), response, header, extra)

    def _move(self, header: Header, response: SetAssembly.Response, extra: list[bytes]) -> None:
        """Move objects to poses, all at once."""
        seen = self._present().seen
        poses = {name: Pose.from_vector(values) for name, values in header["poses"].items()}
        moved = [replace(item, pose=poses[item.id]) for item in seen.objects if item.id in poses]
        self._propose(PerceivedScene.after(self._scene, seen.with_object(*moved)), response, header, extra)

    def _propose(
        self, scene: PerceivedScene, response: SetAssembly.Response, header: Header, extra: list[bytes]
    ) -> None:
        """The server decides whether this becomes the assembly that is set."""
        found = stability_of(scene.analysis, response, Deadline(header["deadline"]))
        response.assumptions = [*response.assumptions, *scene.settled.sentences]
        if found.doubtful and header["do"] == "set":
            raise not_checked()
        self._next = header["next"], scene
        for assembly in (scene.settled.assembly, scene.seen if scene.uncertain else None):
            message = None if assembly is None else _stamped(assembly_message(assembly, header["frame"]), header)
            extra.append(b"" if message is None else serialize_message(message))
        if not found.stable:
            raise unstable(found.falling, found.margin)

    def _present(self) -> PerceivedScene:
        if self._scene is None:
            raise InputError(ErrorCode.EMPTY, "no assembly has been set; call set_assembly, or send one along")
        return self._scene

    def _scene_for(self, request: Any) -> PerceivedScene:
        """Of the assembly that a call brings, else of the one that was set."""
        if not request.assembly:
            return self._present()
        seen = self._doubt.applied(assembly_of(request.assembly[0], self._folders))
        self._recent = PerceivedScene.after(self._recent, seen, related=False)
        return self._recent

    def _markers(self, header: Header) -> list[Any]:
        """Of the assembly that is set, and of what was answered about it here."""
        analysis, frame = self._present().analysis, header["frame"]
        if self._map is None and self._marker_map_points and header["map"]:
            with contextlib.suppress(PoiseError):  # an assembly that does not stand has no map
                self._map = robustness_map(analysis, self._marker_map_points, deadline=_MARKER_SECONDS)
        markers = scene_markers(analysis, frame)
        markers += mechanism_markers(analysis, self._results, frame) if self._results else []
        return markers + (map_markers(self._map, frame) if self._map is not None else [])


def load_type_supports() -> None:
    """Do what serializing the first messages would do, so that forked workers have it done."""
    for service in _KINDS.values():
        for kind in (service.Request, service.Response):
            deserialize_message(serialize_message(kind()), kind)
    serialize_message(MarkerArray())


def _stamped(message: AssemblyMessage, header: Header) -> AssemblyMessage:
    """With the frame and the stamp of an exchange."""
    message.header.frame_id = header["frame"]
    message.header.stamp.sec, message.header.stamp.nanosec = header["stamp"]
    return message
