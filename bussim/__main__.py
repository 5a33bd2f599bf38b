"""The program: ``bussim``, and ``python -m bussim``."""

from __future__ import annotations

import atexit
import os
import signal
import sys
from typing import NoReturn


def program() -> NoReturn:
    """Run the command line as a process of its own, and end with its exit code.

    While it is imported, an interrupt ends the process without a word; then Ctrl-C and SIGTERM end a command
    in order. Signals that are ignored (as in a shell's background jobs) stay ignored.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    from bussim.cli import INTERRUPTED, TERMINATED, Terminated, main

    def terminate(*_: object) -> None:
        raise Terminated

    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, terminate)
    code = main()
    if code in (INTERRUPTED, TERMINATED):
        # With -m, Python ends itself by SIGINT (-2, not 130) once an interrupt has left a text's exec(), as
        # dataclasses are made by one, even where it was caught since. What runs at its end is run here.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        atexit._run_exitfuncs()  # noqa: SLF001 - what was registered must run, and nothing public runs it
        sys.stderr.flush()
        os._exit(code)
    sys.exit(code)


if __name__ == "__main__":
    program()
