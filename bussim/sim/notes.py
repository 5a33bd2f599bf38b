"""Notes and warnings of a run, which the reporters of all buses make."""

from __future__ import annotations

from bussim.trace.records import NoteRecord
from bussim.trace.sink import Sink
from bussim.words.language import say


class Notes:
    """Writes notes to a sink, and keeps warnings for the user until the end of the run."""

    def __init__(self, sink: Sink) -> None:
        self._sink = sink
        #: Warnings for the user after the run, each once.
        self.warnings: list[str] = []

    def note(self, tick: int, kind: str, where: str, text: str, **detail: int | str) -> None:
        """Record a note."""
        self._sink.take(NoteRecord(tick, kind, where, text, detail))

    def warn(self, text: str) -> None:
        """Warn the user after the run, once."""
        if text not in self.warnings:
            self.warnings.append(text)

    def undetected(self, tick: int, receiver: str, sender: str, what: str) -> None:
        """A receiver accepted a frame that no station sent."""
        text = say("note_undetected", sender=sender, kind=what)
        self.note(tick, "undetected", receiver, text, sender=sender)
