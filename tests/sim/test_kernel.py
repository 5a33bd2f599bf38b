from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import pytest
from hypothesis import given
from hypothesis import strategies as st

from bussim.sim.kernel import DEADLINES, FAULT, HEARING, SENDING, Kernel, Timer

PRIORITIES = (FAULT, HEARING, DEADLINES, SENDING)
TIMERS = 5
#: What an action does to a timer: which one, and to what (None: cancel).
OPS = st.lists(st.tuples(st.integers(0, TIMERS - 1), st.none() | st.integers(0, 6)), max_size=3)


@dataclass
class Play:
    """Timers whose nth firing does the nth list of things."""

    script: list[list[tuple[int, int | None]]]
    kernel: Kernel = field(default_factory=Kernel)
    log: list[tuple[int, int]] = field(default_factory=list)

    def __post_init__(self) -> None:
        self.timers: list[Timer] = [
            self.kernel.timer(self.action(number), PRIORITIES[number % 4]) for number in range(TIMERS)
        ]

    def action(self, number: int) -> Callable[[int], None]:
        def fire(now: int) -> None:
            assert now == self.kernel.now
            self.log.append((now, number))
            if len(self.log) <= len(self.script):
                self.do(self.script[len(self.log) - 1])

        return fire

    def do(self, ops: list[tuple[int, int | None]]) -> None:
        for number, delay in ops:
            timer = self.timers[number]
            if delay is None:
                timer.cancel()
            else:
                timer.set(self.kernel.now + delay)


@given(first=OPS, script=st.lists(OPS, max_size=30), steps=st.lists(st.integers(1, 9), max_size=12))
def test_timers_fire_alike_in_steps_of_any_size(
    first: list[tuple[int, int | None]], script: list[list[tuple[int, int | None]]], steps: list[int]
) -> None:
    play, stepwise = Play(script), Play(script)
    play.do(first)
    play.kernel.run(1000)
    stepwise.do(first)
    for step in steps:
        stepwise.kernel.run(stepwise.kernel.now + step)
    stepwise.kernel.run(1000)
    assert play.log == stepwise.log
    ticks = [tick for tick, _ in play.log]
    assert ticks == sorted(ticks)


def test_at_one_tick_faults_come_first_and_transmissions_last() -> None:
    kernel, log = Kernel(), list[int]()
    for priority in (SENDING, DEADLINES, FAULT, HEARING):
        kernel.at(7, lambda _, p=priority: log.append(p), priority)  # type: ignore[misc]
    kernel.run(8)
    assert log == [FAULT, HEARING, DEADLINES, SENDING]


def test_what_is_due_at_the_end_of_a_run_belongs_to_the_next() -> None:
    kernel, log = Kernel(), list[int]()
    kernel.at(10, log.append, FAULT)
    kernel.run(10)
    assert (log, kernel.now) == ([], 10)
    kernel.run(11)
    assert (log, kernel.now) == ([10], 11)


@pytest.mark.parametrize("again", [4, 20])
def test_a_timer_fires_at_the_tick_that_it_was_last_set_to(again: int) -> None:
    kernel, log = Kernel(), list[int]()
    timer = kernel.timer(log.append, HEARING)
    timer.set(10)
    timer.set(again)
    kernel.run(100)
    assert log == [again]
    timer.set(110)
    timer.cancel()
    timer.set(120)
    kernel.run(200)
    assert log == [again, 120]
    assert timer.at == -1
