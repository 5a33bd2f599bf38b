"""One simulation at a time, in a process of its own, whose progress is told and which can be stopped."""

from __future__ import annotations

import multiprocessing
import time
import traceback
from collections.abc import Iterator, Mapping
from multiprocessing.connection import Connection
from pathlib import Path
from typing import Any

from bussim.errors import BussimError
from bussim.units import TICKS_PER_SECOND

#: Seconds between two reports of progress.
_EVERY = 0.1


class Running:
    """A simulation that has been started. ``text`` is its scenario, ``folder`` the one that it writes."""

    def __init__(self, text: str, files: Mapping[str, bytes], folder: Path, *, trace: bool) -> None:
        context = multiprocessing.get_context("spawn")
        self._end, child = context.Pipe(duplex=False)
        self._process = context.Process(
            target=_simulate, args=(child, text, files, folder, trace), daemon=True
        )
        self._process.start()
        child.close()
        self._stopped = False

    def stop(self) -> None:
        """End it. Its folder stays as ``….incomplete``."""
        self._stopped = True
        self._process.kill()

    def events(self) -> Iterator[dict[str, Any]]:
        """What it says: ``progress``, then ``finished``, ``failed`` or ``stopped``; it is over then."""
        try:
            while True:
                event = self._end.recv()
                yield event
                if event["event"] != "progress":
                    return
        except (EOFError, OSError):
            self._process.join()
            if self._stopped:
                yield {"event": "stopped"}
            else:
                yield {"event": "failed", "text": f"the simulation's process ended: {self._process.exitcode}"}
        finally:
            self._process.kill()
            self._process.join()
            self._end.close()


def _simulate(end: Connection, text: str, files: Mapping[str, bytes], folder: Path, trace: bool) -> None:  # noqa: FBT001
    """The process: simulate, and say how far it is."""
    from bussim.api import examine, run

    begun = said = time.monotonic()

    def tell(done: int, total: int) -> None:
        nonlocal said
        now = time.monotonic()
        if now - said >= _EVERY and done:
            said = now
            left = (now - begun) * (total - done) / done
            simulated = done / TICKS_PER_SECOND
            end.send({"event": "progress", "done": done / total, "simulated_s": simulated, "left_s": left})

    try:
        scenario = examine(text, files=files).get()
        result = run(scenario, out=folder, numbered=True, trace=trace, progress=tell)
    except BussimError as error:
        end.send({"event": "failed", "text": str(error)})
    except BaseException:
        end.send({"event": "failed", "text": traceback.format_exc(limit=-1)})
        raise
    else:
        end.send({"event": "finished", "folder": str(result.folder)})
