"""A Modbus slave on a port of its own, in a thread of its own: without a scenario around it."""

import threading
from collections.abc import Mapping
from functools import partial
from typing import Self

from bussim.devices.v80.map import V80
from bussim.engines.modbus.adu import Mode
from bussim.engines.modbus.events import RequestServed
from bussim.engines.modbus.server import RegisterMap
from bussim.line.characters import CharFormat
from bussim.live.faults import FaultyReplies, FaultySlave
from bussim.live.modbus import line_of, slave_runner
from bussim.live.options import DEFAULT_OPTIONS, PortOptions
from bussim.live.wire import Wire


class ServedSlave:
    """Devices that respond as Modbus slaves on a port until :meth:`close`.

    ``maps`` are the devices by station (default: a V80 as station 1). ``delay`` (ticks) is from a
    request's end to its reply. Raises UsageError if the port cannot be opened::

        with ServedSlave("pty") as slave:
            client = MyClient(slave.device)
    """

    def __init__(
        self,
        url: str = "pty",
        maps: Mapping[int, RegisterMap] | None = None,
        *,
        mode: Mode = Mode.RTU,
        baud: int = 115200,
        fmt: CharFormat | None = None,
        delay: int = 0,
        options: PortOptions = DEFAULT_OPTIONS,
    ) -> None:
        self.maps: dict[int, RegisterMap] = dict(maps) if maps is not None else {1: V80()}
        self.reports: list[str] = []
        self.mode = mode
        self.wire = Wire(url, line_of(mode, baud, fmt), options, report=self.reports.append)
        #: What befalls the next replies.
        self.faults = FaultyReplies(mode)
        self._runner = slave_runner(
            self.wire,
            mode,
            self.maps,
            delay=delay,
            handling=self.faults,
            slave=partial(FaultySlave, faults=self.faults),
        )
        self._stop = threading.Event()
        self._error: BaseException | None = None
        self._runner.start()
        self._thread = threading.Thread(target=self._run, name=f"bussim {self.wire.name}", daemon=True)
        self._thread.start()

    def _run(self) -> None:
        try:
            self._runner.run(self._stop.is_set)
        except BaseException as error:  # raised in close(), where the caller can handle it
            self._error = error

    @property
    def device(self) -> str:
        """What a client opens."""
        return self.wire.name

    @property
    def requests(self) -> list[RequestServed]:
        """What was asked, in order: the first requests. ``number`` 0: of a station that is not there."""
        return list(self.faults.requests)

    @property
    def rejected(self) -> dict[str, int]:
        """Frames that were ignored, by reason."""
        return dict(self.faults.rejected)

    def close(self) -> None:
        """Stop serving and close the port. Raises what stopped the thread, if something did."""
        self._stop.set()
        self._thread.join()
        self._runner.close()
        if self._error is not None:
            error, self._error = self._error, None
            raise error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
