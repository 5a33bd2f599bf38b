"""For people who test their own Modbus masters: a served bus with scripted faults, and a pytest plugin.

With bussim installed, pytest has two fixtures. ``modbus_slave`` is a slave, station 1, on a new
pseudo-terminal; ``modbus_serve`` makes slaves as a test wants them::

    def test_my_client_retries(modbus_slave):
        modbus_slave.registers[5] = 1234
        modbus_slave.drop_reply()  # the next reply never comes
        client = MyClient(modbus_slave.device)
        assert client.read_register(5) == 1234
        assert len(modbus_slave.requests) == 2  # it has asked twice


    def test_two_stations(modbus_serve):
        bus = modbus_serve(stations=(3, 4), mode="ascii", delay=0.01)
        bus.station(4).coils[7] = 1
        bus.exception(2, count=3, station=4)
        ...

Faults befall replies one after the other, in the order in which they were asked for; with ``station`` those
of one station. Addresses count from 0, as in frames; times are seconds, or texts with a unit ("10 ms").
``asked`` has every request, those to absent stations too. A pseudo-terminal has no parity: open ``device``
with 8N1. It needs a system with pseudo-terminals (Linux, macOS); elsewhere the fixtures skip, and
``modbus_serve(url="listen://127.0.0.1:0")`` gives a ``socket://`` to open.

Without pytest: ``with ServedBus() as bus: …``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from bussim.testing.served import Asked, Items, ServedBus, Station

__all__ = ["Asked", "Items", "ServedBus", "Station"]


def __getattr__(name: str) -> object:
    # pytest imports this package in every session: what it offers is imported when it is used.
    if name in __all__:
        from bussim.testing import served as bus

        return getattr(bus, name)
    raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
