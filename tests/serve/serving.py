"""Sessions in a thread, for the test to be the other side."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from types import TracebackType
from typing import Any, Self

from bussim.live.options import PortOptions
from bussim.scenario.loader import loads
from bussim.serve.session import Session
from bussim.serve.targets import targets
from bussim.trace.records import RunTotals
from bussim.units import TICKS_PER_SECOND

#: Seconds: nothing here takes so long unless something is broken.
PATIENCE = 30.0
#: Chunks may be far apart on a machine that has something else to do.
LENIENT = PortOptions(tolerance=TICKS_PER_SECOND // 5)

HEAD = "schema: 1\nname: test\nduration: 60 s\nseed: 4\n"

#: A V80 and a register map on one bus, RTU; a PLC's slave port, ASCII, on another. The V80 takes its time:
#: it needs less silence than the other one, who would hear request and reply as one.
SLAVES = f"""{HEAD}
buses: [{{name: line, baud: 115200, format: 8N1}}, {{name: text, baud: 115200, format: 8N1}}]
plcs:
  - name: plc
    scan: 2 ms
    ports:
      COM3: {{bus: text, protocol: modbus-ascii-slave, station: 5}}
devices:
  - {{name: v80, model: v80, bus: line, station: 1, delay: 2 ms}}
  - name: oven
    model: map
    bus: line
    station: 2
    registers: [{{address: 0, count: 20, value: 7, writable: true}}]
  - {{name: ascii, model: v80, bus: text, station: 1, mode: ascii}}
"""


class Serving:
    """A session that runs until the block is left; :meth:`totals` are then its counts."""

    def __init__(
        self,
        text: str,
        *nodes: str,
        ports: tuple[str, ...] = (),
        options: PortOptions = LENIENT,
        **settings: Any,
    ) -> None:
        scenario = loads(text)
        self.reported: list[str] = []
        self.session = Session(
            scenario,
            targets(scenario, nodes, ports),
            options=options,
            report=self.reported.append,
            **settings,
        )
        self._stop = threading.Event()
        self._error: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def _run(self) -> None:
        try:
            self.session.run(self._stop.is_set)
        except BaseException as error:
            self._error = error

    @property
    def device(self) -> str:
        """What the other side opens, where there is one line."""
        (device,) = self.session.devices.values()
        return device

    def wait_for(self, condition: Callable[[], bool]) -> None:
        """Wait until something is so, not for ever."""
        until = time.monotonic() + PATIENCE
        while not condition() and self._error is None:
            assert time.monotonic() < until
            time.sleep(0.01)

    def totals(self) -> RunTotals:
        return self.session.totals()

    def __enter__(self) -> Self:
        self.session.__enter__()
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: TracebackType | None,
    ) -> None:
        self._stop.set()
        self._thread.join(PATIENCE)
        self.session.__exit__()
        if self._error is not None:
            raise self._error
