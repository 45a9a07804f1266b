"""The process behind acceleration_limits: it reads an assembly, finds its contacts, and computes limits."""

from collections.abc import Sequence
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
from rclpy.serialization import deserialize_message, serialize_message

from poise.assembly import Analysis, acceleration_limits, settle
from poise.assembly.contact import Structure
from poise.assembly.robustness import AccelerationLimits
from poise.errors import ErrorCode, InputError, PoiseError
from poise.geometry import Pose
from poise.nodes.assembly_message import assembly_of
from poise.nodes.payload import weighed
from poise.nodes.request_checks import check_assembly
from poise.nodes.runtime import coded
from poise.nodes.workers import Exchange, Header
from poise_msgs.msg import Assembly as AssemblyMessage
from poise_msgs.msg import InertialEstimate

_MOVERS = "first_to_move"


class AccelerationWorker:
    """Answers exchanges: `hold` brings an assembly, `solve` asks for limits of the one that is held.

    Args:
        folders: in which meshes may lie.
        payload: id of the object that gets the payload of an estimate; empty: none.
        payload_pose: (7,) of that object in the sensor's frame.
    """

    def __init__(self, folders: Sequence[str], payload: str, payload_pose: Sequence[float]) -> None:
        self._folders = tuple(Path(folder) for folder in folders)
        self._payload, self._pose = payload, Pose.from_vector(payload_pose)
        self._structure: Structure | None = None

    def __call__(self, header: Header, messages: list[bytes]) -> Exchange:
        """Answer one exchange; an error becomes `error`: code, message, and the ids that it names."""
        answer: Header = {}
        try:
            if header["do"] == "hold":
                self._hold(messages[0], answer)
            else:
                answer["limits"] = self._solved(header, messages)
        except MemoryError:
            what = "the assembly needs more memory than worker_memory"
            answer["error"] = [int(ErrorCode.BAD_INPUT), what, []]
        except Exception as failure:  # of any kind: the limits before must not stay
            error = coded(failure)
            answer["error"] = [int(error.code), error.message, list(error.data.get("objects", []))]
        return answer, []

    def _hold(self, serialized: bytes, answer: Header) -> None:
        self._structure = None
        try:
            message = deserialize_message(serialized, AssemblyMessage)
        except Exception as failure:  # of the middleware
            what = f"the message on assembly cannot be read: {failure!r}"
            raise InputError(ErrorCode.BAD_INPUT, what) from failure
        answer["frame"], answer["payload"] = message.header.frame_id, self._payload in {o.id for o in message.objects}
        check_assembly(message)
        self._structure = Structure.of(settle(assembly_of(message, self._folders)).assembly)
        answer["gravity"] = np.asarray(self._structure.assembly.gravity).tolist()

    def _solved(self, header: Header, messages: list[bytes]) -> Header:
        """The limits of the base at rest under `gravity`, with the payload as it is weighed."""
        if self._structure is None:
            raise PoiseError(ErrorCode.INTERNAL, "this worker has no assembly")
        assembly = self._structure.assembly
        if messages and self._payload in assembly.index:
            payload = assembly.objects[assembly.index[self._payload]]
            assembly = assembly.with_object(weighed(payload, _estimate(messages[0]), self._pose))
        # The contacts are the same: only weights and gravity have changed.
        assembly = replace(assembly, gravity=np.array(header["gravity"]))
        analysis = Analysis(replace(self._structure, assembly=assembly))
        found = acceleration_limits(analysis, header["azimuths"], header["longest"], axis=header["axis"])
        plain = {
            one.name: np.asarray(getattr(found, one.name)).tolist() for one in fields(found) if one.name != _MOVERS
        }
        return plain | {_MOVERS: found.first_to_move}


def limits_of(plain: Header) -> AccelerationLimits:
    """Limits as a worker answered them."""
    movers = tuple(tuple(names) for names in plain[_MOVERS])
    arrays = {name: np.array(plain[name]) for name in ("directions", "limits", "offsets", "doubtful")}
    arrays["normals"] = np.array(plain["normals"], dtype=np.float64).reshape(-1, 3)
    return AccelerationLimits(**{**plain, **arrays, _MOVERS: movers})


def load_type_supports() -> None:
    """Do what serializing the first messages would do, so that forked workers have it done."""
    for kind in (AssemblyMessage, InertialEstimate):
        deserialize_message(serialize_message(kind()), kind)


def _estimate(serialized: bytes) -> InertialEstimate:
    found: InertialEstimate = deserialize_message(serialized, InertialEstimate)
    return found
