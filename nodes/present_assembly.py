"""The assembly that robustness_server has, and what a worker proposes instead."""

from typing import NamedTuple

from rclpy.serialization import deserialize_message

from poise.errors import PoiseError
from poise_msgs.msg import Assembly as AssemblyMessage


class PresentAssembly(NamedTuple):
    """The assembly that is set, at one moment.

    Args:
        version: that callers see.
        frame: of its poses.
        message: None before the first and after a bad message.
        serialized: the same.
        key: of this assembly, for the workers; no other assembly, set or refused, has it.
        problem: what callers get instead of answers about it.
        seen: serialized, with the poses as they were seen; empty where these are certain.
        seen_message: the same; None where they are certain.
    """

    version: int
    frame: str
    message: AssemblyMessage | None = None
    serialized: bytes = b""
    key: int = 0
    problem: PoiseError | None = None
    seen: bytes = b""
    seen_message: AssemblyMessage | None = None


class Proposal(NamedTuple):
    """What a worker has computed, to be the assembly instead of that of a version.

    Args:
        serialized: the assembly, settled.
        seen: as it was seen, serialized; empty where its poses are certain.
        frame, key: of it.
        instead_of: the version.
    """

    serialized: bytes
    seen: bytes
    frame: str
    key: int
    instead_of: int

    def as_present(self, version: int) -> PresentAssembly:
        """It, once it is set."""
        message = deserialize_message(self.serialized, AssemblyMessage)
        seen = deserialize_message(self.seen, AssemblyMessage) if self.seen else None
        return PresentAssembly(version, self.frame, message, self.serialized, self.key, None, self.seen, seen)
