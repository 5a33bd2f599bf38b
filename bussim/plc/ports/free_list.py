"""A list of free-protocol instructions that takes a program's place: which of them is driven in a scan."""

from collections.abc import Sequence

from bussim.engines.free.events import Ended, Received
from bussim.engines.modbus.polls import PollList
from bussim.plc.ports.events import FreeReceived
from bussim.plc.ports.spec import FreeSpec


def listener_of(specs: Sequence[FreeSpec]) -> FreeSpec | None:
    """The instruction that only receives. Raises ValueError for more than one."""
    listeners = [spec for spec in specs if not spec.sends]
    if len(listeners) > 1:
        names = ", ".join(spec.name for spec in listeners)
        raise ValueError(f"{names} only receive; one port can drive one of them")
    return listeners[0] if listeners else None


class FreeList:
    """Deals the port out to its instructions, one at a time.

    One that sends has its turn when it is due: its send request is set, and the turn is over when its
    bytes have left or, where it also receives, with a reception, or when no byte of a reply has come
    within the port's timeout after the last one sent (assumed: as a program's own timer would do).
    Between the turns the one that only receives is driven; a reception that has begun is not disturbed.
    """

    def __init__(self, specs: Sequence[FreeSpec], timeout: int, now: int) -> None:
        self._timeout = timeout
        self._listener = listener = listener_of(specs)
        self._listens_from = now + listener.at if listener is not None else 0
        self._receptions = listener.times if listener is not None else 0  # that are left, None: no limit
        self._turns = PollList([spec for spec in specs if spec.sends], now)
        self._turn: FreeSpec | None = None
        self._limit: int | None = None  # when a turn's wait for a reply is over
        #: The instruction that is driven.
        self.current: FreeSpec | None = None
        self._took = False  # a reception was taken over for it

    def sent(self, end: int) -> None:
        """The bytes of the running turn have left (or cannot be sent)."""
        if self._turn is not None:
            if self._turn.count:
                self._limit = end + self._timeout
            else:
                self._over(end)

    def received(self) -> None:
        """A reception of the instruction that is driven was taken over."""
        self._took = True

    def give_up(self, now: int, *, receiving: bool) -> FreeReceived | None:
        """End the running turn if its reply has not come in time; returns the event, else None."""
        if self._turn is None or self._limit is None or self._took or receiving or now < self._limit:
            return None
        nothing = FreeReceived(self._turn.name, Received(now, None, b"", Ended.TIMEOUT))
        self._over(now)
        return nothing

    def _over(self, now: int) -> None:
        self._turn = self._limit = None
        self._turns.ended(now, None)

    def execute(self, now: int, *, receiving: bool) -> tuple[FreeSpec | None, bool]:
        """Which instruction is driven in the scan that begins now, and whether its turn begins."""
        if self._took:
            self._took = False
            if self._turn is not None:
                self._over(now)
            elif self._receptions:
                self._receptions -= 1
        if self._turn is None and not receiving:
            self._turn = self._turns.take(now)
            if self._turn is not None:
                self.current = self._turn
                return self._turn, True
        self.current = self._turn or self._listening(now)
        return self.current, False

    def _listening(self, now: int) -> FreeSpec | None:
        return self._listener if now >= self._listens_from and self._receptions != 0 else None

    def next_due(self) -> int | None:
        """The earliest tick at which a scan that begins then executes something else."""
        if self._limit is not None:
            return self._limit
        if self._turn is not None:
            return None
        due = self._turns.next_due()
        if self._listener is not None and self.current is None and self._receptions != 0:
            return self._listens_from if due is None else min(due, self._listens_from)
        return due
