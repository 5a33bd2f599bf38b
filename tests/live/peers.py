"""Modbus peers of other projects, on the ends of pseudo-terminals."""

from __future__ import annotations

import asyncio
import contextlib
import os
import sys
import threading
import time
from collections.abc import Iterable
from typing import Any

import pytest

from bussim.engines.modbus.adu import Mode

if sys.platform != "win32":
    from bussim.live.pseudo import PseudoTerminal

#: Seconds: nothing here takes so long unless something is broken.
PATIENCE = 10.0


def peer(name: str) -> Any:
    """A module that CI must have, and others may lack."""
    if os.environ.get("CI"):
        return __import__(name, fromlist=["*"])
    return pytest.importorskip(name)


def pymodbus_master(device: str, mode: Mode, **settings: Any) -> Any:
    """A connected synchronous pymodbus client on 8N1: a pseudo-terminal has no parity."""
    client = peer("pymodbus.client").ModbusSerialClient(
        device,
        framer=peer("pymodbus").FramerType(mode.value),
        baudrate=115200,
        bytesize=8,
        parity="N",
        timeout=PATIENCE,
        retries=0,
        **settings,
    )
    assert client.connect()
    return client


def minimal_master(device: str, mode: Mode, station: int = 1) -> Any:
    """A minimalmodbus instrument on 8N1."""
    minimalmodbus = peer("minimalmodbus")
    instrument = minimalmodbus.Instrument(device, station, mode=mode.value)
    instrument.serial.baudrate = 115200
    instrument.serial.timeout = 2.0  # it waits so long for the rest of every exception
    instrument.clear_buffers_before_each_transaction = True
    return instrument


class PymodbusServer:
    """A pymodbus server in a thread, on one end of a pair of pseudo-terminals; ``device`` is the other.

    Station 1 has the given holding registers and coils, four each of the other two kinds. ``delays`` are
    seconds by which its first responses come later; ``echo`` is the adapter's in front of it.
    """

    def __init__(
        self,
        mode: Mode,
        registers: list[int],
        coils: list[bool],
        delays: Iterable[float] = (),
        *,
        echo: bool = False,
    ) -> None:
        self._mode, self._registers, self._coils = mode, registers, coils
        self._delays = iter(delays)
        self._pair = TerminalPair(echo=echo)
        self.device = self._pair.left
        self._loop = asyncio.new_event_loop()
        self._ready = threading.Event()
        self._failed: BaseException | None = None
        self._thread = threading.Thread(target=self._run, daemon=True)

    def __enter__(self) -> PymodbusServer:
        self._pair.__enter__()
        self._thread.start()
        assert self._ready.wait(PATIENCE)
        if self._failed:
            raise self._failed
        return self

    def __exit__(self, *_: object) -> None:
        asyncio.run_coroutine_threadsafe(self._server.shutdown(), self._loop).result(PATIENCE)
        self._thread.join(PATIENCE)
        self._pair.__exit__()

    def _run(self) -> None:
        asyncio.set_event_loop(self._loop)
        try:
            self._loop.run_until_complete(self._serve())
        except BaseException as error:
            self._failed = error
            self._ready.set()
        finally:
            self._loop.close()

    def _delayed(self, sending: bool, pdu: Any) -> Any:
        if sending:
            time.sleep(next(self._delays, 0))
        return pdu

    async def _serve(self) -> None:
        server, simulator = peer("pymodbus.server"), peer("pymodbus.simulator")
        kinds = simulator.DataType
        device = simulator.SimDevice(
            1,
            simdata=(
                [simulator.SimData(0, values=self._coils, datatype=kinds.BITS)],
                [simulator.SimData(0, values=[False, True, True, False] * 4, datatype=kinds.BITS)],
                [simulator.SimData(0, values=self._registers, datatype=kinds.REGISTERS)],
                [simulator.SimData(0, values=[5, 6, 7, 8], datatype=kinds.REGISTERS)],
            ),
        )
        self._server = server.ModbusSerialServer(
            device,
            framer=peer("pymodbus").FramerType(self._mode.value),
            port=self._pair.right,
            baudrate=115200,
            bytesize=8,
            parity="N",
            stopbits=1,
            trace_pdu=self._delayed,
        )
        await self._server.serve_forever(background=True)
        self._ready.set()
        with contextlib.suppress(asyncio.CancelledError):
            await self._server.serving


class TerminalPair:
    """Two pseudo-terminals whose inner ends a thread joins: a null-modem cable.

    With ``echo`` the left end receives what it sends, too, as some RS485 adapters do.
    """

    def __init__(self, *, echo: bool = False) -> None:
        self._echo = echo
        self._ends = [PseudoTerminal(), PseudoTerminal()]
        self.left, self.right = (end.device for end in self._ends)
        self._stop = threading.Event()
        #: Bytes that went from left to right, and from right to left.
        self.carried = [bytearray(), bytearray()]
        self._threads = [threading.Thread(target=self._carry, args=(side,), daemon=True) for side in (0, 1)]

    def _carry(self, side: int) -> None:
        source, target = self._ends[side], self._ends[1 - side]
        while not self._stop.is_set():
            data = source.read(0.05)
            if data:
                self.carried[side] += data
                if self._echo and side == 0:
                    source.write(data)
                target.write(data)

    def __enter__(self) -> TerminalPair:
        for thread in self._threads:
            thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self._stop.set()
        for thread in self._threads:
            thread.join()
        for end in self._ends:
            end.close()
