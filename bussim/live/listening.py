"""A TCP port that waits for a client, as a port: raw bytes, one client at a time."""

import contextlib
import select
import socket

from bussim.live.options import CHUNK


class ListeningSocket:
    """An :class:`~bussim.live.endpoints.Endpoint` that clients open as ``socket://HOST:PORT``.

    Port 0 is one that is free. What is sent while no client is there is lost; the next client has its turn
    when the one before has gone. Raises OSError where the address cannot be listened on.
    """

    instant = True
    framed = False
    warnings: tuple[str, ...] = ()

    def __init__(self, host: str, port: int) -> None:
        self._client: socket.socket | None = None
        self._listener = socket.create_server((host, port))
        #: What may be waited for: a client, or what it sends.
        self.handle: int | None = self._listener.fileno()
        self.name = f"socket://{host}:{self._listener.getsockname()[1]}"

    def read(self, timeout: float) -> bytes:
        """See the protocol."""
        ready, _, _ = select.select((self._client or self._listener,), (), (), timeout)
        if not ready:
            return b""
        if self._client is None:
            self._client, _ = self._listener.accept()
            self._client.settimeout(0)
            self.handle = self._client.fileno()
            self._client.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
            return b""
        try:
            data = self._client.recv(CHUNK)
        except BlockingIOError:
            return b""
        except OSError:
            data = b""
        if not data:
            self._gone()
        return data

    def write(self, data: bytes) -> int:
        """See the protocol."""
        if self._client is None:
            return 0
        try:
            return self._client.send(data)
        except BlockingIOError:
            return 0
        except OSError:
            self._gone()
            return 0

    def _gone(self) -> None:
        if self._client is not None:
            self._client.close()
            self._client, self.handle = None, self._listener.fileno()

    def close(self) -> None:
        """See the protocol."""
        self._gone()
        with contextlib.suppress(OSError):
            self._listener.close()
