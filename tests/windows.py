"""A Windows of sorts: ``python -m tests.windows`` runs commands without what only POSIX has.

The libraries are imported as on this system; to bussim ``sys.platform`` is then ``win32``, and modules that
Windows lacks cannot be imported. Prints what was done, a line each.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import sys
import tempfile
from collections.abc import Sequence
from pathlib import Path

#: Modules of the standard library that Windows lacks.
LACKING = ("fcntl", "grp", "pty", "pwd", "resource", "termios", "tty")
#: What bussim imports, now or later.
LIBRARIES = (
    "click", "fastcrc", "filelock", "jinja2", "joblib", "joblib.externals.loky", "matplotlib.backends.backend_agg",
    "matplotlib.backends.backend_svg", "matplotlib.figure", "matplotlib.font_manager", "numpy", "pandas", "pyarrow",
    "pyarrow.parquet", "pydantic", "rich.console", "rich.progress", "rich.table", "scipy.optimize", "scipy.stats",
    "serial", "serial.rfc2217", "serial.rs485", "serial.tools.list_ports", "simpy", "socket", "vcd", "yaml",
)  # fmt: skip


def become_windows() -> None:
    """From here on this process is on Windows, as far as bussim can see."""
    for name in LIBRARIES:
        importlib.import_module(name)
    for name in LACKING:
        sys.modules[name] = None  # type: ignore[assignment] # so that importing it raises ImportError
    sys.platform = "win32"


def ended(words: Sequence[str]) -> tuple[int, str]:
    """Exit code and messages of a command."""
    from bussim.cli import main

    said = io.StringIO()
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(said):
        return main(words), said.getvalue()


def commands(folder: Path) -> None:
    """Import every command, and run those that need no port to their end."""
    from bussim.cli import COMMANDS, cli

    for name in COMMANDS:
        assert cli.get_command(None, name) is not None  # type: ignore[arg-type] # it takes no context
        print(f"imported {name}")
    short = ["two_stations", "--duration", "1s"]
    run, swept = str(folder / "run"), str(folder / "sweep")
    for words in (
        ["check", "two_stations", "nn_with_modbus"],
        ["run", *short, "--trace", "--out", run],
        ["run", *short, "--trace", "--out", run, "--force"],
        ["exact", "two_stations"],
        ["size", "two_stations", "--out", str(folder / "size")],
        ["sweep", *short, "--vary", "seed=1,2", "--workers", "1", "--out", swept],
        ["sweep", *short, "--vary", "seed=1,2", "--workers", "1", "--out", swept, "--force"],
        ["export", run, "--to", "vcd"],
        ["plot", run, "--out", str(folder / "x.png")],
        ["timeline", run, "--out", str(folder / "y.png")],
        ["report", run, "-o", str(folder / "x.html")],
        ["sniff", run],
        ["fit", run, "-o", str(folder / "fitted.yaml")],
    ):
        assert ended(words)[0] == 0, (words, ended(words))
        print(f"ran {words[0]}")


def control() -> None:
    """What controls a served session, where there are no Unix sockets."""
    from bussim.serve.control import ControlServer, running

    server = ControlServer("test", lambda request: {"did": request["do"]})
    try:
        (found,) = running()
        assert isinstance(found._port, int)
        assert found.ask(do="inject")["did"] == "inject"
    finally:
        server.close()
    assert running() == []
    print("controlled")


if __name__ == "__main__":
    become_windows()
    with tempfile.TemporaryDirectory() as place:
        commands(Path(place))
    control()
    code, text = ended(["serve", "nn_with_modbus", "feeder1", "--for", "1s"])
    assert code == 2, text
    assert "Windows has no pseudo-terminals" in text, text
    print("served nothing")
