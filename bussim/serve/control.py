"""Control of a serving process while it runs: a request is one line of JSON, and so is the reply.

It listens on a Unix socket in a folder that only its user may enter, or, where there are no such
sockets (Windows), on a port of the loopback interface that wants a token from a file there. Nothing
is ever reachable from another computer.

===========  ==================================================  ==================================
``do``       more of the request                                 reply
===========  ==================================================  ==================================
``list``     —                                                   ``scenario``, ``nodes``, ``now_s``
``inject``   ``node``, ``kind``, ``values`` (texts by option)    ``text``, ``odd`` (list)
===========  ==================================================  ==================================

Every reply has ``ok``; where it is false, ``error`` says why in words.
"""

import contextlib
import hmac
import json
import os
import secrets
import socket
import stat
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from bussim.errors import BussimError, UsageError
from bussim.files import not_written

#: Bytes of a request or a reply at most.
_LONGEST = 256 * 1024
#: Seconds that a peer may take for its line, and between two checks whether to end.
_LONGEST_WAIT, _CHECK_EVERY = 10.0, 0.2
#: Peers that are answered at the same time.
_MOST_PEERS = 32
_UNIX = sys.platform != "win32" and hasattr(socket, "AF_UNIX")

Handler = Callable[[dict[str, Any]], dict[str, Any]]


def control_folder() -> Path:
    """The folder of the user's control sockets, made if it is not there.

    Raises UsageError where another user could get at it.
    """
    runtime = os.environ.get("XDG_RUNTIME_DIR")
    if runtime:
        folder = Path(runtime) / "bussim"
    elif sys.platform == "win32":
        folder = Path(tempfile.gettempdir()) / "bussim"
    else:
        folder = Path(tempfile.gettempdir()) / f"bussim-{os.getuid()}"
    try:
        folder.mkdir(mode=0o700, parents=True, exist_ok=True)
        found = folder.lstat()
    except OSError as error:
        raise not_written(folder, error, "be used for control sockets") from error
    if not stat.S_ISDIR(found.st_mode):
        raise UsageError(f"{folder} is no folder: control sockets cannot lie there")
    if sys.platform != "win32" and (found.st_uid != os.getuid() or found.st_mode & 0o077):
        raise UsageError(f"{folder} is not this user's alone: control sockets would not be safe there")
    return folder


class ControlServer:
    """Serves requests in threads, one a peer, until :meth:`close`. ``handle`` may raise BussimError."""

    def __init__(self, scenario: str, handle: Handler) -> None:
        self._handle = handle
        self._token = secrets.token_hex(16)
        folder = control_folder()
        self._note = folder / f"{os.getpid()}.json"
        self._path: Path | None = None
        self._note.unlink(missing_ok=True)  # of a process of the same number that was killed
        self._listener, where = self._listen(folder / f"{os.getpid()}.sock")
        self._listener.settimeout(_CHECK_EVERY)
        self._write_note({"scenario": scenario, "token": self._token, **where})
        self._closing = threading.Event()
        self._free = threading.BoundedSemaphore(_MOST_PEERS)
        self._thread = threading.Thread(target=self._serve, name="bussim control", daemon=True)
        self._thread.start()

    def _listen(self, path: Path) -> tuple[socket.socket, dict[str, Any]]:
        if _UNIX:
            listener = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            try:
                path.unlink(missing_ok=True)
                listener.bind(str(path))
                path.chmod(0o600)
            except OSError:  # a path that is too long, or a file system without sockets
                listener.close()
            else:
                self._path = path
                listener.listen(_MOST_PEERS)
                return listener, {"socket": str(path)}
        listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
        listener.bind(("127.0.0.1", 0))
        listener.listen(_MOST_PEERS)
        return listener, {"port": listener.getsockname()[1]}

    def _write_note(self, note: dict[str, Any]) -> None:
        handle = os.open(self._note, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600)
        with os.fdopen(handle, "w", encoding="utf-8") as file:
            json.dump(note, file, allow_nan=False)

    def close(self) -> None:
        """No more requests."""
        self._closing.set()
        self._thread.join()
        self._listener.close()
        for path in (self._note, self._path):
            if path is not None:
                with contextlib.suppress(OSError):
                    path.unlink()

    def _serve(self) -> None:
        while not self._closing.is_set():
            try:
                peer, _ = self._listener.accept()
            except TimeoutError:
                continue
            except OSError:
                return
            if self._free.acquire(blocking=False):
                threading.Thread(target=self._answer, args=(peer,), name="bussim peer", daemon=True).start()
            else:
                with peer, contextlib.suppress(OSError):
                    peer.settimeout(_CHECK_EVERY)
                    peer.sendall(_line({"ok": False, "error": f"{_MOST_PEERS} peers are answered already"}))

    def _answer(self, peer: socket.socket) -> None:
        try:
            with peer, contextlib.suppress(OSError):
                peer.sendall(_line(self._reply(_line_from(peer))))
        finally:
            self._free.release()

    def _reply(self, text: bytes) -> dict[str, Any]:
        try:
            request = json.loads(text)
        except (ValueError, RecursionError):
            late = "" if text.endswith(b"\n") else f", or not whole within {_LONGEST_WAIT:g} s"
            return {"ok": False, "error": f"this is no line of JSON{late}"}
        token = request.get("token") if isinstance(request, dict) else None
        if not isinstance(token, str) or not _same(token, self._token):
            return {"ok": False, "error": "this has not the token of this process"}
        try:
            return {"ok": True, **self._handle(request)}
        except BussimError as error:
            return {"ok": False, "error": str(error)}


def _same(token: str, own: str) -> bool:
    """Whether a token is the right one; of JSON, it may be any text, even halves of characters."""
    return hmac.compare_digest(token.encode(errors="surrogatepass"), own.encode())


def _line_from(peer: socket.socket) -> bytes:
    """What a peer sends, up to the end of its line or of its time."""
    text, until = bytearray(), time.monotonic() + _LONGEST_WAIT
    with contextlib.suppress(TimeoutError):
        while not text.endswith(b"\n") and len(text) < _LONGEST:
            peer.settimeout(max(0.001, until - time.monotonic()))
            chunk = peer.recv(4096)
            if not chunk:
                break
            text += chunk
    return bytes(text)


def _line(data: dict[str, Any]) -> bytes:
    # Pure ASCII: a request may stand in it, even with half characters.
    return json.dumps(data, allow_nan=False).encode() + b"\n"


# -- the other side ----------------------------------------------------------------------------


class Running:
    """A process that serves, as its note describes it."""

    def __init__(self, process: int, note: dict[str, Any]) -> None:
        self.process = process
        self.scenario = str(note.get("scenario", ""))
        self._token = str(note.get("token", ""))
        self._socket, self._port = note.get("socket"), note.get("port")

    def ask(self, **request: Any) -> dict[str, Any]:
        """Its reply. Raises UsageError where it refuses, OSError where it is not there any more."""
        with self._connected() as peer:
            peer.sendall(_line({"token": self._token, **request}))
            text = peer.makefile("rb").readline(_LONGEST)
        try:
            reply: dict[str, Any] = json.loads(text)
        except ValueError as error:
            raise UsageError(f"process {self.process} gave no reply") from error
        if not reply.get("ok"):
            raise UsageError(str(reply.get("error")))
        return reply

    def _connected(self) -> socket.socket:
        if _UNIX and isinstance(self._socket, str):
            peer = socket.socket(socket.AF_UNIX, socket.SOCK_STREAM)
            target: Any = self._socket
        else:
            peer = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
            target = ("127.0.0.1", int(self._port or 0))
        peer.settimeout(10.0)
        try:
            peer.connect(target)
        except OSError:
            peer.close()
            raise
        return peer


def running() -> list[Running]:
    """The user's processes that serve, by their numbers. Notes of processes that are gone are removed."""
    return sorted(_running(), key=lambda one: one.process)


def _running() -> Iterator[Running]:
    for path in control_folder().glob("*.json"):
        try:
            found = Running(int(path.stem), json.loads(path.read_text(encoding="utf-8")))
            found.ask(do="list")
        except (ConnectionRefusedError, FileNotFoundError):
            with contextlib.suppress(OSError):
                path.unlink()
                path.with_suffix(".sock").unlink()
        except (OSError, ValueError, UsageError):
            continue  # another process's by now, or not ready
        else:
            yield found
