"""The part of ``bussim sniff`` that listens to a port."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import click

from bussim.errors import UsageError
from bussim.live.arrival import Arrivals
from bussim.live.clock import Clock
from bussim.live.endpoints import PortInUseError
from bussim.live.runner import PATIENCE
from bussim.live.stopping import Stopping
from bussim.live.waiting import wait
from bussim.live.wire import Wire

if TYPE_CHECKING:
    from bussim.line.characters import LineTiming
    from bussim.live.options import PortOptions
    from bussim.live.sniff.recognise import Recogniser

#: Pictures of the table a second.
_PICTURES = 4


def listen(
    url: str,
    bridge: str | None,
    timing: LineTiming,
    options: PortOptions,
    listener: Recogniser,
    limit: int | None,
    picture: Callable[[int], Any] | None,
) -> int:
    """Listen until ``limit`` ticks have passed or Ctrl-C; returns the ticks that it took.

    ``picture`` gives what to show at a tick, None: nothing is shown.
    """
    from rich.live import Live

    clock = Clock()
    wires = [
        Wire(each, timing, options, clock=clock, report=lambda text: click.echo(text, err=True))
        for each in ([url] if bridge is None else [url, bridge])
    ]
    with ExitStack() as stack:
        stop = stack.enter_context(Stopping())
        for wire in wires:
            _open(wire)
            stack.callback(wire.close)
        for wire in wires:
            if wire.name != wire.url:
                click.echo(f"listening on {wire.name}", err=True)
        if wires[0].framed:
            listener.framed = wires[0].characters
        live = stack.enter_context(Live(auto_refresh=False, transient=True)) if picture is not None else None
        arrivals, shown = Arrivals(timing), 0
        while not stop() and (limit is None or clock.now() < limit):
            now = clock.now()
            if live is not None and picture is not None and now >= shown:
                live.update(picture(now), refresh=True)
                shown = now + 72_000_000 // _PICTURES
            end = now + PATIENCE if limit is None else min(now + PATIENCE, limit)
            if not _hear(wires, arrivals, listener, end):
                listener.idle(clock.now())
        if live is not None and picture is not None:
            live.update("")
    return clock.now()


def _open(wire: Wire) -> None:
    try:
        wire.open()
    except PortInUseError as error:
        raise UsageError(
            f"{error}, and two programs on one port take each other's bytes. To listen, take a second "
            f"adapter on the line that only receives, or stand in between: end that program, "
            f"bussim sniff pty:/tmp/tap --bridge {wire.url}, and let it open /tmp/tap"
        ) from error


def _hear(wires: list[Wire], arrivals: Arrivals, listener: Recogniser, until: int) -> bool:
    """Wait for characters, at the longest up to a tick; hand them on where two wires are bridged."""
    clock, heard = wires[0].clock, False
    wait(wires, clock, until)
    for wire in wires:
        data = wire.read(clock.now())
        if data:
            arrived = clock.now()
            for other in wires:
                if other is not wire:
                    other.write(data)
            listener.chars(arrivals.chunk(data, arrived))
            heard = True
    return heard
