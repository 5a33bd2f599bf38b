"""Ordinary link scans that are passed at once leave the engines as their frames do, one by one."""

from __future__ import annotations

from collections.abc import Sequence
from copy import deepcopy
from random import Random
from typing import Any

import numpy as np
import pytest

from bussim.engines.contract import Transmit
from bussim.engines.nn.frames import LinkSettings, data_chars
from bussim.engines.nn.master import Master, MasterConfig
from bussim.engines.nn.monitor import SlaveConfig
from bussim.engines.nn.ordinary import ordinary_scans
from bussim.engines.nn.slave import Slave

MODES = tuple(range(5))
CHAR, POLL, SIZES = 18_750, 5 * 18_750, (8, 12, 24, 40, 72)


class Link:
    """A master and slaves that all hear each other."""

    def __init__(self, slaves: int, mode: int) -> None:
        settings = LinkSettings(slaves, mode, 3, 10)
        self.data = data_chars(mode) * CHAR
        self.master = Master(MasterConfig(settings, 4, 7_200_000, 30_060, 253_440))
        self.slaves = [Slave(SlaveConfig(k, MODES, 720_000, 37_260, CHAR)) for k in range(1, slaves + 1)]
        self.master.image = bytes(SIZES[mode])
        for slave in self.slaves:
            slave.image = self.master.image
            slave.start(0)
        self.master.start(0)

    def next_due(self) -> int:
        """When the master sends next; its events are dropped."""
        while (item := self.master.poll()) is not None:
            if isinstance(item, Transmit):
                return item.at
        return self.master.due

    def frame(self, start: int, turnaround: int) -> int:
        """Send the master's frame that is due, and the reply to it; returns when the next one is due."""
        frame = self.master.begin_transmit(start)
        end = start + len(frame.chars) * CHAR
        for slave in self.slaves:
            slave.receive_frame(frame, start, end)
        self.master.transmit_done(end)
        polled = next((slave for slave in self.slaves if slave.due >= 0), None)
        if polled is not None:
            polled.due, begun = -1, end + turnaround
            reply = polled.begin_transmit(begun, polled.due_counter)
            over = begun + len(reply.chars) * CHAR
            for engine in (*self.slaves, self.master):
                if engine is not polled:
                    engine.receive_frame(reply, begun, over)
            polled.transmit_done(over)
        return self.next_due()

    def scan(self, start: int, turnarounds: Sequence[int]) -> int:
        """Do a link scan frame by frame; returns when the next one is due."""
        due = self.frame(start, 0)
        for turnaround in turnarounds:
            due = self.frame(due, turnaround)
        return due

    def state(self) -> list[Any]:
        """All that the engines know, but frames that are only kept since they may come again."""
        left_out = ("_events", "_reader", "config", "_scans")
        found: list[Any] = [self.master.deadline(), *(slave.deadline() for slave in self.slaves)]
        for engine in (self.master, *self.slaves):
            values = {key: value for key, value in vars(engine).items() if key not in left_out}
            status = values.pop("status")
            found += [values, {name: getattr(status, name) for name in status.__slots__}]
        return found


@pytest.mark.parametrize(
    ("slaves", "mode", "number"), [(1, 0, 1), (1, 4, 40), (3, 2, 2), (7, 2, 17), (7, 1, 33)]
)
def test_at_once_and_frame_by_frame(slaves: int, mode: int, number: int) -> None:
    rng = Random(slaves + number)
    link = Link(slaves, mode)
    link.scan(link.frame(link.next_due(), 0), [30_060] * slaves)  # after the parameters
    start = link.master.due
    turnarounds = np.array([[rng.randrange(0, 40_000) for _ in range(number)] for _ in range(slaves)])
    other = deepcopy(link)
    assert other.master.ordinary
    assert all(slave.in_step(other.master) for slave in other.slaves)

    due = start
    for column in turnarounds.T.tolist():
        due = link.scan(due, column)

    scans = ordinary_scans(other.master.config, other.master.counter, start, turnarounds, POLL, other.data)
    other.master.begin_transmit(start)
    other.master.pass_scans(scans)
    for slave in other.slaves:
        slave.pass_scans(scans)
    assert scans.starts[-1] == due == other.next_due()
    assert other.state() == link.state()
    assert scans.first(1).number == 1
    assert scans.first(1).end == scans.replied[-1, 0]


@pytest.mark.parametrize("missing", [0, 1, 2])
def test_who_is_not_in_step(missing: int) -> None:
    link = Link(3, 2)
    assert not link.master.ordinary  # no slave has replied yet
    link.scan(link.frame(link.next_due(), 0), [30_060] * 3)
    assert link.master.ordinary
    slave = link.slaves[missing]
    slave.status.flags[(missing + 1) % 3 + 1] = True
    assert not slave.in_step(link.master)
    assert [other.in_step(link.master) for other in link.slaves].count(True) == 2
