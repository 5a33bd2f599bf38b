"""How the bytes of the free protocol lie in D registers (PW10 board manual, sections 5 and 6)."""

from collections.abc import Sequence


def unpack(words: Sequence[int], count: int, *, eight_bit: bool) -> bytes:
    """The first ``count`` bytes of registers: one a word (``eight_bit``), or two, low byte first.

    Raises ValueError if there are fewer.
    """
    if count > (len(words) if eight_bit else 2 * len(words)):
        raise ValueError(f"{len(words)} registers do not hold {count} bytes")
    if eight_bit:
        return bytes(word & 0xFF for word in words[:count])
    return b"".join((word & 0xFFFF).to_bytes(2, "little") for word in words)[:count]


def pack(data: bytes, *, eight_bit: bool) -> list[int]:
    """Registers that hold bytes. An odd last byte leaves the high byte of its word 0 (assumed)."""
    if eight_bit:
        return list(data)
    padded = data + b"\0" if len(data) % 2 else data
    return [padded[at] | padded[at + 1] << 8 for at in range(0, len(padded), 2)]
