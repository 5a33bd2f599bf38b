"""What ``bussim poll`` does and shows."""

from __future__ import annotations

from contextlib import ExitStack, closing
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from bussim.commands.common.output import print_json
from bussim.commands.sniff.tally import statistics
from bussim.engines.modbus.codes import MEANINGS
from bussim.engines.modbus.pdu import READS
from bussim.files import not_written
from bussim.live.polling import PollTurns, Turn
from bussim.live.wire import Wire
from bussim.results.meters.histogram import Histogram
from bussim.results.store.tables import INT, MILLISECONDS, SECONDS, TEXT, CsvTable
from bussim.units import milliseconds, nanoseconds, seconds
from bussim.wording import counted
from bussim.words.formats import meaning

if TYPE_CHECKING:
    from bussim.commands.poll.plan import Plan, Planned
    from bussim.engines.modbus.events import ForeignFrame
    from bussim.live.options import PortOptions

#: Columns of the CSV file.
COLUMNS = {
    "time_s": SECONDS,
    "station": INT,
    "function": INT,
    "address": INT,
    "count": INT,
    "attempts": INT,
    "outcome": TEXT,
    "response_ms": MILLISECONDS,
    "values": TEXT,
}

#: After so many losses without a turn in between a number of rounds is given up.
_LOSSES = 3
#: The outcome of a write whose response was the adapter's echo.
_ECHO = "echo, no response"


class _ShownWire(Wire):
    """A wire whose bytes are shown as they come and go, in lines that ``sniff`` reads.

    A time is that of the last stop bit: sent bytes have left then, others were handed over by the system.
    """

    def read(self, until: int) -> bytes:
        """See the base class."""
        data = super().read(until)
        self._show("<", bytes(self.characters[value].value for value in data), self.clock.now())
        return data

    def write(self, data: bytes) -> None:
        """See the base class."""
        lasts = 0 if self.instant else self.timing.characters(len(data))
        self._show(">", data, self.clock.now() + lasts)
        super().write(data)

    def _show(self, direction: str, data: bytes, end: int) -> None:
        if data:
            click.echo(f"{seconds(end):.6f} {direction} {data.hex(' ')}", err=True)


class Tally:
    """What came of one poll so far."""

    def __init__(self, planned: Planned) -> None:
        self.planned = planned
        self.turns = self.attempts = self.ok = self.exceptions = 0
        self.late = self.mismatched = self.computer_late = 0
        self.errors: dict[str, int] = {}
        self.times = Histogram()
        self.values: list[int | float | str] = []

    def add(self, turn: Turn) -> None:
        """Take in a turn, without what failed while this computer was late."""
        self.computer_late += len(turn.late)
        self.turns += turn.last not in turn.late
        self.attempts += len(turn.attempts) - len(turn.late)
        self.mismatched += turn.mismatched
        for attempt in turn.attempts:
            if attempt.error is not None and attempt not in turn.late:
                word = _outcome(attempt.error, attempt.exception)
                self.errors[word] = self.errors.get(word, 0) + 1
        if turn.echoed:
            self.errors[_ECHO] = self.errors.get(_ECHO, 0) + 1
        elif turn.ok:
            self.ok += 1
            self.values = _values(turn, self.planned)
        elif turn.last.exception:
            self.exceptions += 1
        if turn.response is not None:
            self.times.add(turn.response)

    @property
    def failed(self) -> bool:
        """Whether something is wrong, or nothing is known to be right."""
        return self.ok < max(self.turns, min(1, self.computer_late)) or self.mismatched > 0

    def to_json(self) -> dict[str, Any]:
        """Plain data; times in ms."""
        request = self.planned.poll.request
        return {
            "name": self.planned.name,
            "station": self.planned.poll.station,
            "function": int(request.function),
            "address": request.address,
            "count": request.quantity,
            "turns": self.turns,
            "attempts": self.attempts,
            "ok": self.ok,
            "exceptions": self.exceptions,
            "late": self.late,
            "mismatched": self.mismatched,
            "computer_late": self.computer_late,
            "errors": dict(sorted(self.errors.items())),
            "response_ms": statistics(self.times),
            "values": self.values,
        }


def poll(
    plan: Plan,
    url: str,
    *,
    options: PortOptions,
    rounds: int | None,
    csv: Path | None,
    as_json: bool,
    verbose: bool = False,
) -> int:
    """Poll until every poll had its rounds, or until Ctrl-C; prints the summary.

    ``verbose`` shows every byte. Returns the exit code: 1 if a turn failed or ended with an exception.
    """
    from bussim.engines.modbus.polls import PollList
    from bussim.live.echo import RETURNS
    from bussim.live.modbus import PortCheck, master_runner
    from bussim.live.stopping import Stopping

    tallies = [Tally(planned) for planned in plan.polls]
    wire = (_ShownWire if verbose else Wire)(
        url, plan.line, options, report=lambda text: click.echo(text, err=True)
    )
    with ExitStack() as stack:
        table = None if csv is None else stack.enter_context(closing(_table(csv)))

        losses = 0  # when the latest turn ended

        def given_up() -> bool:
            return rounds is not None and wire.counts.losses - losses >= _LOSSES

        def on_turn(turn: Turn) -> None:
            nonlocal losses
            losses = wire.counts.losses
            echoed = check.is_echo(turn.last)
            untimed = turn.instead is None and not echoed and check.no_time(turn.last)
            turn = replace(turn, echoed=echoed, timed=not untimed)
            tally = tallies[turn.index]
            tally.add(turn)
            if table is not None:
                table.append(_row(turn, tally.planned))
            if not as_json:
                click.echo(_line(turn, tally.planned))

        polls = [planned.poll for planned in plan.polls]

        def on_late(frame: ForeignFrame) -> None:
            text = _thrown_away(frame, tallies)
            if not as_json:
                click.echo(text)

        turns = PollTurns(polls, on_turn, rounds, on_late)
        runner = master_runner(
            wire,
            plan.mode,
            PollList(polls, pause=plan.pause),
            timeout=plan.timeout,
            interval=plan.interval,
            turnaround=plan.turnaround,
            resync=plan.resync,
            handling=turns,
        )
        check = PortCheck(wire, plan.mode, plan.timeout)
        stop = stack.enter_context(Stopping())
        stack.callback(runner.close)
        runner.start()
        if wire.name != url:
            click.echo(f"polling on {wire.name}", err=True)
        begun = wire.clock.now()
        runner.run(lambda: turns.done or given_up() or stop())
        duration = wire.clock.now() - begun
    summary = {
        "schema": 1,
        "url": url,
        "mode": plan.mode.value,
        "baud": plan.line.baud,
        "format": str(plan.line.format),
        "duration_s": round(seconds(duration), 6),
        "polls": [tally.to_json() for tally in tallies],
        "echo": bool(echoes := check.found or runner.port.echo.found),
        "rejected_frames": dict(sorted(turns.rejected.items())),
        "port": wire.counts.to_json(),
    }
    if as_json:
        print_json(summary)
    else:
        _show(tallies, summary)
    if given_up():
        click.echo(f"{url} was lost {_LOSSES} times without a response: given up", err=True)
    if check.found:
        click.echo(f"{url} {RETURNS}", err=True)
    return 1 if echoes or given_up() or any(tally.failed for tally in tallies) else 0


def _thrown_away(frame: ForeignFrame, tallies: list[Tally]) -> str:
    """Count a late response, and say so."""
    late = frame.late
    assert late is not None  # noqa: S101 - narrows the type; only such frames are passed on
    asked = (late.station, late.request)
    of = next(one for one in tallies if (one.planned.poll.station, one.planned.poll.request) == asked)
    of.late += 1
    after = milliseconds(frame.start - late.asked)
    return f"{of.planned.name}  late: a response {after:.1f} ms after its request, thrown away"


def _table(path: Path) -> CsvTable:
    try:
        return CsvTable(path, COLUMNS)
    except OSError as error:
        raise not_written(path, error) from error


def _row(turn: Turn, planned: Planned) -> tuple[str | int | None, ...]:
    """The row of a turn, in the order of :data:`COLUMNS`."""
    request, response = planned.poll.request, turn.response
    values = _values(turn, planned) if turn.ok else []
    return (
        nanoseconds(turn.ended.start),
        planned.poll.station,
        int(request.function),
        request.address,
        request.quantity,
        len(turn.attempts),
        _word(turn),
        None if response is None else nanoseconds(response),
        " ".join(map(str, values)) or None,
    )


def _word(turn: Turn) -> str:
    error = turn.last.error
    if turn.echoed:
        return _ECHO
    late = ", this computer was late" if turn.last in turn.late else ""
    return "ok" if error is None else _outcome(error, turn.last.exception) + late


def _outcome(error: int, exception: int) -> str:
    if exception:
        return f"exception {exception:02X}, {meaning(f'{exception:02X}', kind='exception')}"
    return MEANINGS[error]


def _values(turn: Turn, planned: Planned) -> list[int | float | str]:
    from bussim.live.value_notation import to_values

    response = turn.last.response
    if response is None or planned.poll.request.function not in READS:
        return []
    if planned.form is None:
        return list(response.values)
    return to_values(response.values, planned.form, big=planned.big)


def _line(turn: Turn, planned: Planned) -> str:
    """A turn for people: ``station 1  [1] 17  [2] 18  (2.4 ms)``."""
    tries = f" after {len(turn.attempts)} attempts" if len(turn.attempts) > 1 else ""
    if not turn.ok:
        return f"{planned.name}  {_word(turn)}{tries}"
    width = 1 if planned.form is None else planned.form.registers
    values = _values(turn, planned)
    if values:
        shown = "  ".join(f"[{planned.first + index * width}] {value}" for index, value in enumerate(values))
    else:
        shown = f"written: {planned.poll.request.quantity} from [{planned.first}]"
    if turn.mismatched:
        return f"{planned.name}  {shown}  (may be the response to an earlier request{tries})"
    time = "" if turn.response is None else f"  ({milliseconds(turn.response):.3f} ms{tries})"
    return f"{planned.name}  {shown}{time}"


def _show(tallies: list[Tally], summary: dict[str, Any]) -> None:
    from rich.text import Text

    from bussim.commands.common.bars import bars
    from bussim.commands.common.console import plain_table, wide_console

    console = wide_console()
    table = plain_table(["poll"], ["turns", "ok", "failed attempts", "median ms", "mean", "max"])
    for tally in tallies:
        figures = tally.to_json()["response_ms"]
        failed = ", ".join(f"{count} × {word}" for word, count in sorted(tally.errors.items())) or "0"
        times = ["–" if figures[key] is None else f"{figures[key]:.3f}" for key in ("p50", "mean", "max")]
        table.add_row(*map(Text, (tally.planned.name, str(tally.turns), str(tally.ok), failed, *times)))
    console.print()
    console.print(table)
    everything = Histogram()
    for tally in tallies:
        everything.merge(tally.times)
    for line in bars(everything):
        console.print(line, markup=False)
    if mismatched := sum(tally.mismatched for tally in tallies):
        click.echo(
            f"mismatched: {counted(mismatched, 'response')} may belong to an earlier request; --resync"
        )
    if late := sum(tally.computer_late for tally in tallies):
        click.echo(f"this computer was late: {counted(late, 'failed attempt')} left out of what is counted")
    for reason, count in summary["rejected_frames"].items():
        click.echo(f"frames that were no responses: {count} × {reason}")
    port = summary["port"]
    if port["losses"] or port["dropped"]:
        lost = f"lost {counted(port['losses'], 'time')} for {port['away_s']:.1f} s, " * (port["losses"] > 0)
        click.echo(f"port: {lost}{counted(port['dropped'], 'byte')} unsent")
