"""``bussim poll``: a Modbus master on the command line."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import click
from click.core import ParameterSource

from bussim.commands.common.output import checked_target
from bussim.commands.common.port_options import format_of, options_of, port_options
from bussim.commands.common.scenario_options import code_option, time_of
from bussim.commands.poll.plan import Plan, Planned
from bussim.engines.modbus.adu import LAST_RESERVED, LAST_STATION
from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.engines.modbus.pdu import Request
    from bussim.live.value_notation import Form

#: Read and write functions by data type; None: cannot be written.
_FUNCTIONS = {"0": (1, 5, 15), "1": (2, None, None), "3": (4, None, None), "4": (3, 6, 16)}
_MOST_BITS, _MOST_WORDS = 2000, 125
#: Of times that are written without a unit, as for mbpoll: their unit, and what mbpoll allows.
_BARE_TIMES = {"-o": ("s", 0.01, 10.0), "-l": ("ms", 10.0, 1e9)}


@click.command()
@click.argument("url", metavar="URL")
@click.argument("values", metavar="[VALUE]...", nargs=-1)
@click.option("-m", "mode", type=click.Choice(["rtu", "ascii"]), default="rtu", show_default=True)
@click.option(
    "-a",
    "stations",
    metavar="N",
    default="1",
    show_default=True,
    help="Stations, such as 1 or 1,3,5:8; 0: all, to write.",
)
@click.option("-b", "baud", metavar="N", type=click.IntRange(1, 4_000_000), default=19200, show_default=True)
@click.option("-d", "data_bits", type=click.IntRange(7, 8), help="Data bits (RTU 8, ASCII 7).")
@click.option("-s", "stop_bits", type=click.IntRange(1, 2), help="Stop bits (1).")
@click.option("-P", "parity", metavar="P", help="Parity: none, even (default) or odd.")
@click.option("-r", "reference", metavar="N", default="1", help="First coil or register (1).")
@click.option("-0", "from_zero", is_flag=True, help="-r counts from 0, as frames do, not from 1.")
@click.option("-c", "count", metavar="N", type=click.IntRange(1, 2000), help="How many values to read (1).")
@click.option(
    "-t",
    "kind",
    metavar="T",
    default="4",
    help="0 coils, 1 inputs, 3 input registers, 4 holding registers (4); with a format for registers: "
    "4:hex, :int16, :int (32 bits), :float, :uint (the default).",
)
@click.option("-B", "big", is_flag=True, help="Of int and float the high word comes first.")
@click.option("-1", "once", is_flag=True, help="Poll once.")
@click.option(
    "-l", "rate", metavar="T", default="1000", show_default=True, help="Pause after each poll, in ms."
)
@click.option("-o", "timeout", metavar="T", default="1", show_default=True, help="Timeout, in seconds.")
@click.option("-v", "verbose", is_flag=True, help="Show all bytes with their times, on standard error.")
@click.option("--rounds", metavar="N", type=click.IntRange(1), help="End after so many rounds.")
@click.option(
    "--retries", metavar="N", type=click.IntRange(0, 100), default=0, help="Attempts after a failed one (0)."
)
@click.option(
    "--resync/--no-resync",
    default=None,
    help="After a timeout, wait where a late response could be taken for another one, and throw it away "
    "(default, but for a PLC's list).",
)
@click.option("--scenario", metavar="FILE", help="Take line and polls from a scenario instead…")
@click.option("--list", "poll_list", metavar="NODE", help="…the poll list of this port, such as press1.COM3.")
@click.option("--paced", is_flag=True, help="Space bytes at the line's rate.")
@click.option("--csv", "csv", metavar="FILE", help="Also write every turn to a CSV file.")
@click.option("--force", is_flag=True, help="Replace the file of --csv if it exists.")
@click.option("--json", "as_json", is_flag=True, help="Print the summary as JSON, and nothing else.")
@code_option
@port_options
@click.pass_context
def command(
    ctx: click.Context,
    url: str,
    values: tuple[str, ...],
    *,
    mode: str,
    stations: str,
    baud: int,
    data_bits: int | None,
    stop_bits: int | None,
    parity: str | None,
    reference: str,
    from_zero: bool,
    count: int | None,
    kind: str,
    big: bool,
    once: bool,
    rate: str,
    timeout: str,
    verbose: bool,
    rounds: int | None,
    retries: int,
    resync: bool | None,
    scenario: str | None,
    poll_list: str | None,
    paced: bool,
    csv: str | None,
    force: bool,
    as_json: bool,
    allow_code: bool,
    tolerance: str,
    echo: bool,
    rs485: str,
) -> None:
    """Poll Modbus stations on a port, or write to them.

    URL is a port (COM7, /dev/ttyUSB0), socket://HOST:PORT, rfc2217://HOST:PORT or pty. With VALUEs
    they are written, once, else values are read until Ctrl-C. Options mean what they mean to mbpoll; times
    may have another unit (500 ms, 2 s), and -m is rtu. The exit code is 1 if a poll failed.
    """
    from bussim.commands.poll.session import poll

    options = options_of(tolerance=tolerance, echo=echo, rs485=rs485, paced=paced)
    if (scenario is None) != (poll_list is None):
        raise UsageError("--scenario and --list belong together: a file, and one of its ports")
    if once and rounds is not None and rounds != 1:
        raise UsageError("-1 is one round: leave it or --rounds out")
    if scenario is not None and poll_list is not None:
        if values:
            raise UsageError("a scenario's poll list knows itself what to write: leave the VALUEs out")
        from bussim.commands.poll.scenario import plan_of

        # Of mbpoll's options only two do not say what line and polls are.
        given = [
            param.opts[0]
            for param in ctx.command.params
            if (len(param.opts[0]) == 2 and param.opts[0] not in ("-1", "-v")) or param.name == "retries"
            if ctx.get_parameter_source(param.name or "") is ParameterSource.COMMANDLINE
        ]
        if given:
            raise UsageError(f"a scenario has line and polls: leave {', '.join(given)} out")
        plan = plan_of(scenario, poll_list, allow_code=allow_code)
    else:
        from bussim.engines.modbus.adu import Mode
        from bussim.live.modbus import STANDARD_FORMATS, line_of

        as_mode = Mode(mode)
        fmt = format_of(STANDARD_FORMATS[as_mode], data_bits=data_bits, parity=parity, stop_bits=stop_bits)
        polls = _polls(
            stations_of(stations), values, kind, reference, count,
            from_zero=from_zero, big=big, retries=retries,
        )  # fmt: skip
        line = line_of(as_mode, baud, fmt)
        plan = Plan(as_mode, line, polls, _time("-o", timeout), pause=_time("-l", rate))
    if resync is not None:
        plan = replace(plan, resync=resync)
    rounds = 1 if once or values else rounds
    if force and csv is None:
        raise UsageError("--force goes with --csv")
    table = None if csv is None else checked_target(Path(csv), (), force=force, option="--csv")
    for station in sorted({planned.poll.station for planned in plan.polls}):
        if station > LAST_STATION:
            click.echo(f"station {station}: numbers above {LAST_STATION} are reserved", err=True)
    ctx.exit(poll(plan, url, options=options, rounds=rounds, csv=table, as_json=as_json, verbose=verbose))


def _time(option: str, text: str) -> int:
    """The ticks of a time whose unit may be left out. Raises UsageError."""
    unit, low, high = _BARE_TIMES[option]
    try:
        bare = float(text)
    except ValueError:
        return time_of(option, text, positive=option == "-o")
    if not low <= bare <= high:
        # Below a limit in seconds it is a short time, above it one in milliseconds.
        meant = f"{text} s" if unit == "ms" else f"{text if bare > high else format(1000 * bare, 'g')} ms"
        raise UsageError(
            f"{option} is {text}, without a unit that is {text} {unit}, allowed {low:g}…{high:g}; "
            f"what is meant may be written with its unit, such as {meant}"
        )
    return time_of(option, f"{text} {unit}")


def stations_of(text: str) -> list[int]:
    """The stations of ``1,3,5:8``. Raises UsageError."""
    found: list[int] = []
    for part in text.split(","):
        match = re.fullmatch(r"\s*(\d{1,3})\s*(?:[:-]\s*(\d{1,3})\s*)?", part)
        if match is None:
            raise UsageError(f"-a has {part!r}, write stations such as 1 or 1,3,5:8")
        first = int(match.group(1))
        last = int(match.group(2) or first)
        if not (0 <= first <= last <= LAST_RESERVED):
            raise UsageError(f"-a has {part.strip()}, allowed are stations 1…{LAST_RESERVED} (0: broadcast)")
        found += range(first, last + 1)
    return list(dict.fromkeys(found))


def _polls(
    stations: list[int],
    values: tuple[str, ...],
    kind: str,
    reference: str,
    count: int | None,
    *,
    from_zero: bool,
    big: bool,
    retries: int,
) -> tuple[Planned, ...]:
    from bussim.engines.modbus.polls import Poll

    space, form = _kind(kind)
    first = _reference(reference, from_zero=from_zero)
    address = first if from_zero else first - 1
    if values and count is not None:
        raise UsageError("-c is how many values are read; with VALUEs as many are written as there are")
    read = _read(space, form, address, count or 1) if not values else None
    request = read or _write(space, form, address, values, big=big)
    if address + request.quantity > 0x10000:
        raise UsageError(f"-r is {reference}: {request.quantity} items from there lie beyond the last one")
    if not values and 0 in stations:
        raise UsageError("-a has 0, the broadcast, to which no station responds: it can only be written to")
    return tuple(
        Planned(Poll(station, request, retries=retries), f"station {station}", first, form, big)
        for station in stations
    )


def _kind(text: str) -> tuple[str, Form | None]:
    from bussim.live.value_notation import Form

    space, _, form = text.partition(":")
    if space not in _FUNCTIONS:
        raise UsageError(f"-t is {text!r}, allowed are 0, 1, 3 and 4, for registers with a format: 4:float")
    if space in "01":
        if form:
            raise UsageError(f"-t is {text!r}, but coils and inputs have no format")
        return space, None
    try:
        return space, Form(form or "uint")
    except ValueError:
        raise UsageError(f"-t has the format {form!r}, allowed are {', '.join(Form)}") from None


def _reference(text: str, *, from_zero: bool) -> int:
    try:
        number = int(text, 0)
    except ValueError:
        raise UsageError(f"-r is {text!r}, not a whole number such as 1 or 0x16") from None
    low = 0 if from_zero else 1
    if not low <= number <= 0xFFFF + low:
        raise UsageError(f"-r is {text}, allowed {low}…{0xFFFF + low}")
    return number


def _read(space: str, form: Form | None, address: int, count: int) -> Request:
    from bussim.engines.modbus.pdu import Request

    quantity = count * (form.registers if form else 1)
    most = _MOST_WORDS if form else _MOST_BITS
    if quantity > most:
        raise UsageError(f"-c is {count}: {quantity} items, a request may name {most}")
    return Request(_FUNCTIONS[space][0], address, quantity)


def _write(space: str, form: Form | None, address: int, values: tuple[str, ...], *, big: bool) -> Request:
    from bussim.engines.modbus.pdu import write_coil, write_coils, write_register, write_registers
    from bussim.live.value_notation import to_words

    if _FUNCTIONS[space][1] is None:
        raise UsageError(f"-t {space} can only be read; coils (0) and holding registers (4) can be written")
    if form is None:
        bits = [_bit(value) for value in values]
        if len(bits) > 1968:
            raise UsageError(f"{len(bits)} coils to write, a request may name 1968")
        return write_coil(address, on=bool(bits[0])) if len(bits) == 1 else write_coils(address, bits)
    try:
        words = to_words(values, form, big=big)
    except ValueError as error:
        raise UsageError(str(error)) from error
    if len(words) > 123:
        raise UsageError(f"{len(words)} registers to write, a request may name 123")
    return write_register(address, words[0]) if len(words) == 1 else write_registers(address, words)


def _bit(text: str) -> int:
    if text not in ("0", "1"):
        raise UsageError(f"the value {text!r} is no coil's: allowed are 0 and 1")
    return int(text)
