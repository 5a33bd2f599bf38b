"""The program: ``bussim``, and ``python -m bussim``."""

from __future__ import annotations

import atexit
import gc
import os
import signal
import sys
import threading
import time
from math import inf
from typing import NoReturn

#: After so many seconds a signal that was lost is sent again: what lost it is over then.
_AGAIN_SECONDS = 0.05
#: Signals within so many seconds of the first one are that one, sent again.
_ONCE_SECONDS = 2.0


def program() -> NoReturn:
    """Run the command line as a process of its own, and end with its exit code.

    While it is imported, an interrupt ends the process without a word; then Ctrl-C and SIGTERM end a command
    in order. Signals that are ignored (as in a shell's background jobs) stay ignored.
    """
    if signal.getsignal(signal.SIGINT) is signal.default_int_handler:
        signal.signal(signal.SIGINT, signal.SIG_DFL)
    # What modules are made of stays: to look for garbage in it again and again is a tenth of a short run. A
    # simulation leaves some ten objects of garbage a second.
    gc.set_threshold(150_000)
    # pydantic would ask every package that is installed whether it has plugins for it.
    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "true")
    from bussim.cli import FAILED, INTERRUPTED, TERMINATED, Terminated, main

    asked: list[type[KeyboardInterrupt]] = []
    last = -inf

    def end(number: int, _: object) -> None:
        nonlocal last
        if time.monotonic() - last < _ONCE_SECONDS:
            return  # the command ends already, which must not be cut short
        last = time.monotonic()
        asked.append(Terminated if number == signal.SIGTERM else KeyboardInterrupt)
        raise asked[-1]

    def unraisable(lost: sys.UnraisableHookArgs) -> None:
        # A signal that comes while a callback of the interpreter runs (of a weak reference, say) would be
        # lost there, and the command would go on: it is sent again.
        if not issubclass(lost.exc_type, (KeyboardInterrupt, Terminated)):
            sys.__unraisablehook__(lost)
            return
        nonlocal last
        last = -inf
        number = signal.SIGTERM if issubclass(lost.exc_type, Terminated) else signal.SIGINT
        threading.Timer(_AGAIN_SECONDS, os.kill, (os.getpid(), number)).start()

    if signal.getsignal(signal.SIGINT) is signal.SIG_DFL:
        signal.signal(signal.SIGINT, end)
    if signal.getsignal(signal.SIGTERM) is signal.SIG_DFL:
        signal.signal(signal.SIGTERM, end)
    sys.unraisablehook = unraisable
    try:
        code = main()
    except Exception:
        if not asked:
            raise
        print("stopped", file=sys.stderr)  # noqa: T201 - main() did not say it
        code = FAILED
    if asked and code:  # pydantic makes an error of its own of what is raised while it writes a model
        code = TERMINATED if asked[-1] is Terminated else INTERRUPTED
    if code in (INTERRUPTED, TERMINATED):
        # With -m, Python ends itself by SIGINT (-2, not 130) once an interrupt has left a text's exec(), as
        # dataclasses are made by one, even where it was caught since. What runs at its end is run here.
        signal.signal(signal.SIGINT, signal.SIG_IGN)
        atexit._run_exitfuncs()  # noqa: SLF001 - what was registered must run, and nothing public runs it
        sys.stderr.flush()
        os._exit(code)
    gc.freeze()  # else Python looks once more through all that it leaves anyway, for a tenth of a short run
    sys.exit(code)


def page() -> NoReturn:
    """Run ``bussim ui``, started without a console."""
    sys.argv.insert(1, "ui")
    program()


if __name__ == "__main__":
    program()
