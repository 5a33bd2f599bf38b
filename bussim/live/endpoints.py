"""Opens what a URL names: a serial port, a socket, a loop or a new pseudo-terminal.

======================  ========================================================================
URL                     what it is
======================  ========================================================================
``COM7``, ``/dev/…``    a serial port of this computer
``socket://HOST:PORT``  raw bytes over TCP (a device server); rate and format are the server's
``listen://HOST:PORT``  a TCP port that others open as ``socket://HOST:PORT``; port 0: a free one
``rfc2217://HOST:PORT`` a remote serial port with rate and format (RFC 2217)
``loop://``             what is sent is received
``pty``, ``pty:PATH``   a new pseudo-terminal, with a link PATH to it that stays the same
======================  ========================================================================

and everything else that pyserial's ``serial_for_url`` knows.
"""

import contextlib
import errno
import os
import select
import sys
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Protocol
from urllib.parse import urlsplit

import serial
from serial.rs485 import RS485Settings

from bussim.errors import UsageError
from bussim.line.characters import CharFormat, LineTiming
from bussim.live.arrival import framed_byte
from bussim.live.clock import as_seconds
from bussim.live.options import CHUNK, DirectionControl, PortOptions

if sys.platform == "win32":
    _SETTING_ERRORS: tuple[type[Exception], ...] = ()
else:
    import termios

    #: What setting parity or 7 data bits raises on a pseudo-terminal.
    _SETTING_ERRORS = (termios.error,)

#: Errors that mean that a port is gone (SerialException is an OSError).
LOST_ERRORS: tuple[type[Exception], ...] = (OSError, *_SETTING_ERRORS)

_IN_USE = "another program has it open"
#: Where programs put their locks of serial ports.
LOCK_FOLDER = Path("/var/lock")
#: Seconds between two reads of a port that cannot be waited for.
_READ_INTERVAL = 0.0005
#: What pyserial's thread of an RFC 2217 port runs.
_READ_LOOP = "_telnet_read_loop"
#: Seconds before its end in which the end of a frame is waited for without sleeping.
_LAST_WAIT = 0.002
#: Seconds after which a write that makes no progress is given up.
_WRITE_TIMEOUT = 1.0


class Endpoint(Protocol):
    """An open port. Every method may raise one of :data:`LOST_ERRORS`: then the port is gone."""

    name: str  # what the other side connects to, or the URL
    handle: int | None  # the file that may be waited for, None where there is none
    instant: bool  # bytes take no time
    framed: bool  # bytes have a bit behind seven data bits, see :func:`bussim.live.arrival.framed_byte`
    warnings: tuple[str, ...]

    def read(self, timeout: float) -> bytes:
        """What has come, as soon as something has; empty after ``timeout`` seconds."""

    def write(self, data: bytes) -> int:
        """Send; returns how many bytes were taken. The rest is lost."""

    def close(self) -> None:
        """Close it; never raises."""


def open_endpoint(url: str, line: LineTiming, options: PortOptions) -> Endpoint:
    """Open what a URL names.

    Raises UsageError for a URL that cannot be opened by any means, one of :data:`LOST_ERRORS` for what
    is not there.
    """
    if url == "pty" or url.startswith("pty:"):
        if sys.platform == "win32":
            raise UsageError("Windows has no pseudo-terminals; use a pair of virtual ports (com0com)")
        from bussim.live.pseudo import PseudoTerminal

        return PseudoTerminal(url.partition(":")[2] or None)
    address = _checked_address(url)
    if address is not None and url.lower().startswith("listen://"):
        from bussim.live.listening import ListeningSocket

        return ListeningSocket(*address)
    return SerialEndpoint(url, line, options)


def _checked_address(url: str) -> tuple[str, int] | None:
    """Host and port of a URL that needs them. Raises UsageError for what is neither, and for no name."""
    if not url.strip():
        raise UsageError("a port without a name: write COM7, /dev/ttyUSB0, socket://HOST:PORT or pty")
    scheme = url.partition("://")[0].lower()
    if scheme not in ("socket", "rfc2217", "listen"):
        return None
    try:
        parts = urlsplit(url)
        host, port = parts.hostname, parts.port
    except ValueError:  # a port that is no number, or none that exists
        host = port = None
    least = 0 if scheme == "listen" else 1  # any that is free
    if not host or port is None or port < least:
        raise UsageError(f"{url} has no host and port: write {scheme}://HOST:PORT, PORT is {least}…65535")
    return host, port


class SerialEndpoint:
    """A port that pyserial opens."""

    def __init__(self, url: str, line: LineTiming, options: PortOptions) -> None:
        self.name = url
        self.instant = _is_instant(url)
        self.warnings: tuple[str, ...] = ()
        self._rts = options.direction is DirectionControl.RTS
        fmt, terminal = line.format, _is_terminal(url)
        # As many bits as 8N1 or 8N2 have: drivers without 7 bits can do them, and parity errors are seen.
        seven = fmt.data_bits == 7 and fmt.bits > 9
        self.framed = seven and not self.instant
        # Linux refuses parity on a pseudo-terminal only sometimes, and else leaves it out in silence.
        plain = terminal and fmt.parity != "N"
        asked = CharFormat(8, "N", fmt.bits - 9) if seven else fmt
        try:
            self._port = _open(url, line.baud, _without_parity(asked) if terminal else asked)
        except _SETTING_ERRORS:
            if plain or asked == _without_parity(asked):
                raise
            plain = True
            self._port = _open(url, line.baud, _without_parity(asked))
        if plain and not seven:
            missing = (
                f"{url} has neither parity nor 7 data bits, as pseudo-terminals have not: "
                f"it is used with 8N{fmt.stop_bits} instead of {fmt}"
            )
            self.warnings = (missing,)
        self._line = line
        self._framed_bytes = bytes(framed_byte(fmt, value) for value in range(256))
        if options.direction is DirectionControl.DRIVER:
            self._set_direction(url)
        if self._rts:
            self._port.rts = False
        self.handle = _handle(self._port)

    def _set_direction(self, url: str) -> None:
        try:
            self._port.rs485_mode = RS485Settings()
        except (ValueError, NotImplementedError, AttributeError) as error:
            self.close()
            raise UsageError(
                f"the driver of {url} cannot switch an RS485 direction ({error}); "
                "most adapters switch by themselves (adapter), else try rts"
            ) from error

    def read(self, timeout: float) -> bytes:
        """See the protocol."""
        if self.handle is None:
            return self._read_repeatedly(timeout)
        ready, _, _ = select.select((self.handle,), (), (), timeout)
        if not ready:
            return b""
        data = os.read(self.handle, CHUNK)
        if not data:
            raise OSError("the other side has closed the connection")
        return data

    def _read_repeatedly(self, timeout: float) -> bytes:
        """For Windows and for ports that are no file: read again and again."""
        until = time.perf_counter() + timeout
        while True:
            data = self._port.read(CHUNK)
            left = until - time.perf_counter()
            if data or left <= 0:
                return bytes(data)
            time.sleep(min(left, _READ_INTERVAL))

    def write(self, data: bytes) -> int:
        """See the protocol."""
        if self.framed:
            data = data.translate(self._framed_bytes)
        try:
            if not self._rts:
                return self._port.write(data) or 0
            self._port.rts = True
            until = time.perf_counter() + as_seconds(self._line.characters(len(data)))
            try:
                taken = self._port.write(data) or 0
                if sys.platform != "win32":  # which looks every 50 ms whether all has left
                    self._port.flush()
                while (left := until - time.perf_counter()) > 0:
                    time.sleep(left - _LAST_WAIT if left > 2 * _LAST_WAIT else 0)
            finally:
                self._port.rts = False
        except serial.SerialTimeoutException:
            return 0
        return taken

    def close(self) -> None:
        """See the protocol."""
        _close(self._port)


def _close(port: serial.Serial) -> None:
    connection = getattr(port, "_socket", None)
    with contextlib.suppress(*LOST_ERRORS, AttributeError):
        port.close()
    if connection is not None:  # which pyserial leaves open if the other side has closed it
        connection.close()


def _without_parity(fmt: CharFormat) -> CharFormat:
    return CharFormat(8, "N", fmt.stop_bits)


def _open(url: str, baud: int, fmt: CharFormat) -> serial.Serial:
    device = "://" not in url
    try:
        port = serial.serial_for_url(
            url,
            do_not_open=True,
            baudrate=baud,
            bytesize=fmt.data_bits,
            parity=fmt.parity,
            stopbits=fmt.stop_bits,
            timeout=0,
            write_timeout=_WRITE_TIMEOUT if device else None,  # no other kind of port has one
        )
    except ValueError as error:
        raise UsageError(f"{url!r} is no port that can be opened: {error}") from error
    if url.startswith("rfc2217://"):
        setattr(port, _READ_LOOP, partial(_read, port, getattr(port, _READ_LOOP)))
    if device:
        _respect_lock(url)
        port.exclusive = True  # two programs on one port take each other's bytes away
    try:
        port.open()
    except (OSError, ValueError) as error:
        _close(port)
        if isinstance(error, OSError):
            raise
        raise UsageError(
            f"{url} cannot be used with {baud} {fmt}: {error}{_control_hint(url, error)}"
        ) from error
    if device and not _is_terminal(url):
        # An FTDI adapter then hands bytes over after 1 ms and not 16; drivers that know no latency refuse it.
        with contextlib.suppress(AttributeError, ValueError, OSError):
            port.set_low_latency_mode(True)
    return port


def _control_hint(url: str, error: Exception) -> str:
    if not url.startswith("rfc2217://") or "control" not in str(error) or "ign_set_control" in url:
        return ""
    return f"; if the server has no control lines: {url}{'&' if '?' in url else '?'}ign_set_control"


def _read(port: serial.Serial, loop: Callable[[], None]) -> None:
    """A thread's loop without a traceback: pyserial's reads say that their thread has died.

    A connection that the other side has ended is closed here, since pyserial forgets it open.
    """
    connection = getattr(port, "_socket", None)
    with contextlib.suppress(Exception):
        loop()
    if connection is not None:
        connection.close()


def _respect_lock(url: str) -> None:
    """Raise OSError if a program that keeps lock files (minicom, ser2net) uses a port.

    Filesystem Hierarchy Standard 3.0, 5.9: ``LCK..`` and the device's name, its process in ASCII.
    """
    try:
        process = int((LOCK_FOLDER / f"LCK..{Path(os.path.realpath(url)).name}").read_text())
        os.kill(process, 0)
    except PermissionError:  # the process is there, and another user's
        pass
    except (OSError, ValueError):  # no lock, or one that is left over
        return
    raise OSError(errno.EBUSY, os.strerror(errno.EBUSY))


def _is_instant(url: str) -> bool:
    return not url.startswith("rfc2217://") if "://" in url else _is_terminal(url)


def _is_terminal(url: str) -> bool:
    """Whether a device is the end of a pseudo-terminal, by its name."""
    return "://" not in url and os.path.realpath(url).startswith("/dev/pts/")


def _handle(port: serial.Serial) -> int | None:
    """The file to wait for, None where there is none."""
    if sys.platform == "win32":
        return None
    try:
        return int(port.fileno())
    except (OSError, AttributeError):
        return None


class PortInUseError(UsageError):
    """A port that another program has open."""


def why_not(url: str, error: Exception) -> UsageError:
    """Why a port could not be opened, with the ports that are here."""
    reason = _reason(url, error)
    if reason == _IN_USE:
        return PortInUseError(f"{url} cannot be opened: {reason}")
    here = _ports_here(url) + _control_hint(url, error)
    return UsageError(f"{url} cannot be opened: {reason}{here}")


def _ports_here(url: str) -> str:
    if "://" in url or Path(url).exists():
        return ""
    from serial.tools.list_ports import comports

    here = sorted(str(port.device) for port in comports())
    return f"; {'ports here: ' + ', '.join(here) if here else 'no serial port was found here'}"


def _reason(url: str, error: Exception) -> str:
    """The system's message: pyserial repeats the name around it."""
    inner = error.__context__ if isinstance(error, serial.SerialException) else error
    if isinstance(inner, _SETTING_ERRORS):
        return "it is no serial port"
    if not isinstance(inner, OSError) or not inner.strerror:
        return str(error)
    if "://" in url:
        # pyserial writes on after the other side has closed.
        return "the other side has closed the connection" if inner.errno == errno.EBADF else inner.strerror
    if inner.errno in (errno.EAGAIN, errno.EBUSY):
        return _IN_USE
    if inner.errno == errno.EACCES and sys.platform != "win32":
        return f"{inner.strerror}; serial ports are open to the group that owns them, often dialout"
    return inner.strerror
