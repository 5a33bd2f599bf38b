"""Options that commands on a scenario share, and what they mean."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import click

from bussim.errors import UsageError
from bussim.units import parse_time
from bussim.words.tables import LANGUAGES

if TYPE_CHECKING:
    from bussim.scenario.yaml.overrides import Override

#: Without it a scenario that names functions of the user is refused: nothing else runs code.
code_option = click.option(
    "--allow-code",
    is_flag=True,
    help="Load the Python functions that the scenario names; they can do anything.",
)
#: Values that replace those of the file; messages call them by this text.
set_option = click.option(
    "--set", "overrides", metavar="KEY.PATH=VALUE", multiple=True, help="Set a value of the scenario."
)
#: Programs of real PLCs have instructions that are not simulated.
unsimulated_option = click.option(
    "--allow-unsimulated",
    is_flag=True,
    help="Skip the instructions of programs that are not simulated, with a warning for each.",
)


def _use_language(_: click.Context, __: click.Parameter, lang: str | None) -> None:
    """Use the language until the program ends: that of the system where none is given."""
    from bussim.words.language import choose_language, system_language

    choose_language(lang or system_language())


#: The language of what a command shows; the command itself need not know it.
lang_option = click.option(
    "--lang",
    type=click.Choice(LANGUAGES),
    help="Language, English or Chinese. [default: that of the system]",
    callback=_use_language,
    expose_value=False,
)


def values_of(
    sets: Sequence[str], *, allow_unsimulated: bool = False, **short: str | None
) -> list[str | Override]:
    """What ``--set`` sets, and the options that stand for one key: ``seed``, ``allow_unsimulated``."""
    from bussim.scenario.yaml.overrides import Override

    given = [Override(key, value, f"--{key} {value}") for key, value in short.items() if value is not None]
    if allow_unsimulated:
        given.append(Override("allow_unsimulated", "true", "--allow-unsimulated"))
    return [*sets, *given]


def time_of(option: str, text: str, *, positive: bool = False) -> int:
    """The ticks of an option's time, not below 0, or above it. Raises UsageError."""
    try:
        ticks = parse_time(text)
    except ValueError as error:
        raise UsageError(f"{option} {error}") from None
    if ticks < 0 or (positive and ticks == 0):
        raise UsageError(f"{option} is {text!r}, it must {'be above' if positive else 'not be below'} 0")
    return ticks
