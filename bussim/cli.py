"""The command line: ``bussim COMMAND``. A command's module is imported when the command is used."""

from __future__ import annotations

import contextlib
import contextvars
import importlib
import io
import logging
import os
import sys
from collections.abc import Sequence

import click

from bussim.errors import RunError, ScenarioError, UsageError
from bussim.version import __version__

#: The commands, in the order of ``--help``, with their one-line descriptions.
COMMANDS = {
    "run": "Simulate a scenario and write its results.",
    "new": "Write a commented scenario to begin with.",
    "check": "Name every mistake of scenarios with its line and column.",
    "exact": "Work out link scan and poll cycle times.",
    "size": "Recommend retries and timeout.",
    "ui": "Show a line on a page, with sliders and answers at once.",
    "watch": "Show chosen devices over time.",
    "sweep": "Run a scenario at every point of a grid.",
    "scenarios": "List, show or copy the built-in scenarios.",
    "plot": "Draw the link scan times of one run or several.",
    "timeline": "Draw a bus like a logic analyser.",
    "export": "Write a run for Wireshark, PulseView, Perfetto.",
    "report": "Write a page on one run, or compare several.",
    "poll": "Poll Modbus stations on a serial port.",
    "serve": "Serve parts of a scenario on real ports, the rest simulated.",
    "inject": "Let a fault begin in a scenario that is being served.",
    "sniff": "Listen to a line, or read a recording of one.",
    "fit": "Estimate a scenario from a recording.",
    "site": "Find causes and noise in registers read on site.",
    "guide": "Show the manual in the terminal.",
}

#: Commands that are a folder of modules.
_FOLDERS = frozenset({"exact", "fit", "poll", "site", "size", "sniff"})

#: Exit codes: a failed run, bad input; interrupted from the keyboard, terminated by the system.
FAILED, BAD_INPUT, INTERRUPTED, TERMINATED = 1, 2, 130, 143


class Terminated(KeyboardInterrupt):
    """SIGTERM, which ends a command as Ctrl-C does, but for its exit code."""


class _Commands(click.Group):
    """A group whose ``--help`` imports no command."""

    def list_commands(self, ctx: click.Context) -> list[str]:
        """The names of all commands."""
        return list(COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        """Import a command, None if there is none of that name."""
        if cmd_name not in COMMANDS:
            return None
        home = f"{cmd_name}.command" if cmd_name in _FOLDERS else cmd_name
        module = importlib.import_module(f"bussim.commands.{home}")
        command: click.Command = module.command
        command.name = cmd_name
        return command

    def format_commands(self, ctx: click.Context, formatter: click.HelpFormatter) -> None:
        """The table of commands, from :data:`COMMANDS`."""
        with formatter.section("Commands"):
            formatter.write_dl(list(COMMANDS.items()))

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command, with the nearest name if there is none."""
        if args and args[0] not in COMMANDS and not args[0].startswith("-"):
            from bussim.wording import shorten
            from bussim.words.values import suggest

            raise click.UsageError(
                f"no command {shorten(args[0])!r}; {suggest(args[0], list(COMMANDS))}", ctx
            )
        return super().resolve_command(ctx, args)


@click.group(cls=_Commands, context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(__version__, "--version", message="bussim %(version)s")
def cli() -> None:
    """Simulate PLCs that share an RS485 wire.

    Link scan times, retries, timeouts and dead stations of N:N links, described in a YAML file.
    """


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line and return the exit code. A language that a command chooses is used for it alone.

    Everything that ends a command becomes a line on standard error here: never a traceback for a mistake of
    the user, a place that cannot be written, too little memory, or an end that was asked for.
    """
    try:
        return contextvars.copy_context().run(_main, arguments)
    except (click.Abort, KeyboardInterrupt) as error:  # also while another error was being put into words
        cause = error.__cause__ or error  # click makes an Abort of every interrupt
        _say(str(cause) or "stopped")
        return TERMINATED if isinstance(cause, Terminated) else INTERRUPTED


def _main(arguments: Sequence[str] | None) -> int:
    for name, mode in (("stdin", "r"), ("stdout", "w"), ("stderr", "w")):
        stream = getattr(sys, name)
        if stream is None:  # it is closed: no file of ours may take its number, here or in workers
            nothing = os.open(os.devnull, os.O_RDWR)
            os.set_inheritable(nothing, True)  # noqa: FBT003 - it takes no keyword
            setattr(sys, name, os.fdopen(nothing, mode, encoding="utf-8"))
        elif mode == "w" and isinstance(stream, io.TextIOWrapper):
            # A file name or a µ that the terminal cannot show must not end the program.
            stream.reconfigure(errors="backslashreplace")
    # Where HOME is empty or cannot be written, matplotlib would warn that it caches its fonts elsewhere.
    logging.getLogger("matplotlib").setLevel(logging.ERROR)
    try:
        code = cli.main(
            args=None if arguments is None else list(arguments), prog_name="bussim", standalone_mode=False
        )
        sys.stdout.flush()
    except click.ClickException as error:
        error.show()
        return error.exit_code
    except ScenarioError as error:
        from bussim.words.language import shown

        _say("\n".join(str(shown(problem)) for problem in error.problems))
        return BAD_INPUT
    except UsageError as error:
        from bussim.words.language import said_text

        _say(said_text("run_error", text=error.args[0]))
        return BAD_INPUT
    except RunError as error:
        _say(f"Error: {error}")
        return FAILED
    except BrokenPipeError:
        _discard_output()
        return FAILED
    except MemoryError:
        _say("Error: there is not enough memory for this")
        return FAILED
    except OSError as error:
        from bussim.files import is_bad_path

        where = error.filename or "the output cannot be written"
        _say(f"Error: {where}: {error.strerror or error}")
        _discard_output()
        return BAD_INPUT if is_bad_path(error) else FAILED
    return code if isinstance(code, int) else 0


def _say(text: str) -> None:
    """Print a line on standard error, where that is still open."""
    from bussim.wording import visible

    with contextlib.suppress(OSError):
        click.echo("\n".join(map(visible, text.split("\n"))), err=True)


def _discard_output() -> None:
    """Keep what could not be written from being written once more, with a complaint, when Python ends."""
    with contextlib.suppress(OSError):
        sys.stdout.flush()
        return
    os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
