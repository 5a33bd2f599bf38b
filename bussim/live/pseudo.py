"""A new pseudo-terminal as a port (POSIX): what opens its other end finds a serial port."""

import contextlib
import os
import select
import sys
from pathlib import Path

from bussim.errors import UsageError
from bussim.files import not_written
from bussim.live.options import CHUNK

assert sys.platform != "win32"  # noqa: S101 - for the type checker; nothing imports this there

import termios  # noqa: E402 (after the assertion)
import tty  # noqa: E402

#: Where termios has the rates.
_INPUT_RATE, _OUTPUT_RATE = 4, 5


class PseudoTerminal:
    """An :class:`~bussim.live.endpoints.Endpoint` at the inner end of a new pseudo-terminal.

    ``link`` is the path of a symbolic link to its outer end, made anew and removed at the end. A link
    that is left over, of a process that was killed, leads nowhere and is replaced; what leads to
    something, or is no link, belongs to another program and is never replaced (UsageError). The outer
    end stays open here, too, so that a client may come and go. A client that does not read loses what no
    longer fits.
    """

    instant = True
    framed = False
    warnings: tuple[str, ...] = ()

    def __init__(self, link: str | None = None) -> None:
        self._link = None if link is None else Path(link)
        if self._link is not None and (why := _taken(self._link)):
            raise UsageError(f"{link} {why}; choose another name for the pty")
        self._inner, self._outer = os.openpty()
        self.handle: int | None = self._inner
        try:
            tty.setraw(self._outer, termios.TCSANOW)
            os.set_blocking(self._inner, False)
            self._forget_rate()
            #: Name of the outer end.
            self.device = os.ttyname(self._outer)
            self.name = self.device
            if self._link is not None:
                self._link.unlink(missing_ok=True)
                self._link.symlink_to(self.device)
                self.name = str(self._link)
        except OSError as error:
            self.close()
            raise not_written(self._link or Path("pty"), error, "be made") from error

    def read(self, timeout: float) -> bytes:
        """See the protocol."""
        ready, _, _ = select.select((self._inner,), (), (), timeout)
        self._forget_rate()
        return os.read(self._inner, CHUNK) if ready else b""

    def _forget_rate(self) -> None:
        """Set a rate that no client wants, so that each that opens it changes something.

        tcsetattr of Linux refuses parity, which a pseudo-terminal has not, if that is all that was to be
        changed: a client with 8E1 could open it once only. The rate itself does nothing there.
        """
        settings = termios.tcgetattr(self._outer)
        if settings[_OUTPUT_RATE] != termios.B50:
            settings[_INPUT_RATE] = settings[_OUTPUT_RATE] = termios.B50
            termios.tcsetattr(self._outer, termios.TCSANOW, settings)

    def write(self, data: bytes) -> int:
        """See the protocol."""
        try:
            return os.write(self._inner, data)
        except BlockingIOError:
            return 0

    def close(self) -> None:
        """See the protocol."""
        for handle in (self._inner, self._outer):
            with contextlib.suppress(OSError):
                os.close(handle)
        if self._link is not None and self._link.is_symlink():
            with contextlib.suppress(OSError):
                if str(self._link.readlink()) == getattr(self, "device", None):
                    self._link.unlink()


def _taken(link: Path) -> str:
    """Why a link's name cannot be used, "" if it can."""
    try:
        if not link.exists():  # nothing, or a link that leads nowhere
            return ""
        if not link.is_symlink():
            return "exists and is no symbolic link"
        where = link.readlink()
    except OSError:  # what is wrong with the name is reported when the link is made
        return ""
    if link.is_char_device():
        return f"leads to {where}, which is in use: another process may be serving there. Remove it if not"
    return f"is a link to {where}"
