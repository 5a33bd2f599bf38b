"""What a scenario says of a PLC's ports and of what is exchanged on them, as frozen values."""

from dataclasses import dataclass

from bussim.plc.memory import Device


@dataclass(frozen=True, slots=True)
class PortSpec:
    """A port that CPAVL has set up (PW10 board manual, section 6).

    ``words`` is the first of its 20 parameter words (S), ``bits`` the first of its 20 bits (D). What
    the words hold at STOP→RUN decides what the port does; a scenario's friendly keys are only
    another way to write these words into the PLC's registers.
    """

    name: str  # "COM2"…"COM6"
    bus: str
    words: Device
    bits: Device


@dataclass(frozen=True, slots=True)
class PollSpec:
    """A Modbus transaction that recurs: one RS2 instruction of a PLC, or one poll of an HMI.

    ``device`` is the first device that is read into or written from: D for registers; for coils M, S,
    Y, or D with sixteen packed in a word; X only to write from; None for an HMI, which keeps what it
    read to itself. ``values``, for a write, are what is written: moved to ``device`` first where
    there is one. It is due ``at`` ticks after RUN (an HMI: after power-on) and then every ``every``
    ticks (0: as soon as the others had their turn), ``times`` times (None: for ever). A failed attempt is
    repeated up to ``retries`` times; after a failed turn only every ``skip_after_failure``-th one is made
    until one is good.
    """

    name: str  # unique among the polls of its master
    port: str  # "COM3"; "" for an HMI
    station: int
    function: int
    address: int
    count: int
    device: Device | None = None
    values: tuple[int, ...] = ()
    every: int = 0
    at: int = 0
    times: int | None = None
    retries: int = 0
    skip_after_failure: int = 1


@dataclass(frozen=True, slots=True)
class FreeSpec:
    """A free-protocol RS2 instruction: ``send_count`` bytes from ``send``, ``count`` bytes into ``device``.

    ``data``, where not empty, is put into the send registers before each turn (``send`` None: it is
    sent from nowhere). Due as a :class:`PollSpec` is. One that only receives (``send_count`` 0) stays
    driven from ``at`` on until it has received ``times`` times, and its "reception complete" is reset
    after every taken reception; ``every`` means nothing to it.
    """

    name: str
    port: str
    send: Device | None = None
    send_count: int = 0
    data: bytes = b""
    device: Device | None = None
    count: int = 0
    every: int = 0
    at: int = 0
    times: int | None = None

    @property
    def sends(self) -> bool:
        """Whether it has turns of its own, in which it sends."""
        return self.send_count > 0

    @property
    def retries(self) -> int:
        """None: a turn of the free protocol is not repeated."""
        return 0

    @property
    def skip_after_failure(self) -> int:
        """Each turn is made: one of the free protocol does not fail."""
        return 1
