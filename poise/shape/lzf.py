"""Bytes that LZF packed (LibLZF), as the Point Cloud Library writes PCD files with DATA binary_compressed."""


def unpacked(packed: bytes, length: int) -> bytes:
    """The bytes that were packed.

    Args:
        packed: runs of literals, and copies of what came before.
        length: of what was packed; more is not unpacked.

    Raises:
        ValueError: the bytes are damaged.
    """
    out, at, end = bytearray(), 0, len(packed)
    while at < end and len(out) <= length:
        control = packed[at]
        at += 1
        if control < 32:
            out += packed[at : at + control + 1]
            at += control + 1
            continue
        count = control >> 5
        more = count == 7
        if at + more >= end:
            break
        if more:
            count += packed[at]
        start = len(out) - ((control & 31) << 8) - packed[at + more] - 1
        at += 1 + more
        if start < 0:
            raise ValueError("a copy begins before the first byte")
        count += 2
        piece = out[start : start + count]
        out += (piece * (count // len(piece) + 1))[:count] if len(piece) < count else piece
    if len(out) != length or at != end:
        raise ValueError(f"it unpacks to {len(out)} bytes instead of {length}")
    return bytes(out)
