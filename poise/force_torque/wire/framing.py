"""Frames in a stream of bytes: found by header and checksum, numbered so that damaged ones show as gaps."""

from collections.abc import Callable


def reflected_crc16(polynomial: int, start: int = 0xFFFF, final: int = 0x0000) -> Callable[[bytes], int]:
    """A CRC-16 that takes the least significant bit first.

    Args:
        polynomial: reflected, as 0xA001 (Modbus) or 0x8408 (X.25).
        start: initial value of the register.
        final: what the register is combined with at the end, by exclusive or.
    """
    table = []
    for byte in range(256):
        for _ in range(8):
            byte = byte >> 1 ^ (polynomial if byte & 1 else 0)
        table.append(byte)

    def crc(data: bytes) -> int:
        register = start
        for byte in data:
            register = register >> 8 ^ table[(register ^ byte) & 0xFF]
        return register ^ final

    return crc


class FrameParser:
    """Finds the valid frames in a stream of bytes that may begin anywhere and be damaged.

    Frames carry no number; this numbers them. Bytes between two valid frames are damaged frames; their numbers are left
    out, so that the loss shows as a gap.

    Args:
        header: first bytes of every frame.
        length: bytes of a frame.
        is_valid: says of `length` bytes that begin with the header whether their checksum holds.

    Attributes:
        rejected: damaged frames so far.
    """

    def __init__(self, header: bytes, length: int, is_valid: Callable[[bytes], bool]) -> None:
        self._header, self._length, self._is_valid = header, length, is_valid
        self.rejected = 0
        self._buffer = b""
        self._skipped = 0
        self._next: int | None = None

    def feed(self, data: bytes) -> list[tuple[int, bytes]]:
        """Take bytes in pieces of any size; return (number, frame) of the frames completed by them."""
        frames: list[tuple[int, bytes]] = []
        buffer = self._buffer + data
        at = 0
        while True:
            start = buffer.find(self._header, at)
            if start < 0:  # the last bytes may be a part of a header
                start = max(len(buffer) - len(self._header) + 1, at)
                while start < len(buffer) and not self._header.startswith(buffer[start:]):
                    start += 1
            self._skipped += start - at
            at = start
            frame = buffer[at : at + self._length]
            if len(frame) < self._length:
                break
            if self._is_valid(frame):
                frames.append((self._number(), frame))
                at += self._length
            else:
                self._skipped += 1
                at += 1
        self._buffer = buffer[at:]
        return frames

    def _number(self) -> int:
        damaged = max(1, round(self._skipped / self._length)) if self._skipped else 0
        self._skipped = 0
        if self._next is None:  # bytes before the first frame are the end of another, or an answer
            damaged, self._next = 0, 0
        self.rejected += damaged
        number = (self._next + damaged) % (1 << 32)
        self._next = number + 1
        return number
