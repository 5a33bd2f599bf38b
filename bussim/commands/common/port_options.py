"""Options that all commands on real ports share, and what they mean."""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, Any, TypeVar

import click

from bussim.commands.common.scenario_options import time_of
from bussim.errors import UsageError

if TYPE_CHECKING:
    from bussim.line.characters import CharFormat
    from bussim.live.options import PortOptions

FuncT = TypeVar("FuncT", bound=Callable[..., Any])

_PARITIES = {"none": "N", "even": "E", "odd": "O", "n": "N", "e": "E", "o": "O"}


def with_options(*options: Callable[[FuncT], FuncT]) -> Callable[[FuncT], FuncT]:
    """A decorator that adds options to a command, in this order."""

    def add(function: FuncT) -> FuncT:
        for option in reversed(options):
            function = option(function)
        return function

    return add


#: Adds ``--tolerance``, ``--echo`` and ``--rs485``.
port_options = with_options(
    click.option(
        "--tolerance",
        metavar="T",
        default="20 ms",
        show_default=True,
        help="Silence inside a frame that the system may have made.",
    ),
    click.option("--echo", is_flag=True, help="The adapter hears what it sends."),
    click.option(
        "--rs485",
        type=click.Choice(["adapter", "driver", "rts"]),
        default="adapter",
        show_default=True,
        help="Who switches the direction of the RS485 line.",
    ),
)


def options_of(*, tolerance: str, echo: bool, rs485: str, paced: bool = False) -> PortOptions:
    """The settings that these options ask for. Raises UsageError."""
    from bussim.live.options import DirectionControl, PortOptions

    return PortOptions(
        tolerance=time_of("--tolerance", tolerance), echo=echo, paced=paced, direction=DirectionControl(rs485)
    )


def parity_of(text: str) -> str:
    """The letter of a parity: N, E or O. Raises UsageError."""
    found = _PARITIES.get(text.lower())
    if found is None:
        raise UsageError(f"the parity is {text!r}, allowed are none, even and odd")
    return found


def format_of(
    default: CharFormat, *, data_bits: int | None, parity: str | None, stop_bits: int | None
) -> CharFormat:
    """A character format, what is not given as in the default. Raises UsageError."""
    from bussim.line.characters import CharFormat

    letter = default.parity if parity is None else parity_of(parity)
    return CharFormat(data_bits or default.data_bits, letter, stop_bits or default.stop_bits)
