"""The files that a scenario names: programs, and tables of times."""

from __future__ import annotations

from pathlib import Path

from bussim.scenario import builtin
from bussim.scenario.wording import shorten


class Files:
    """Finds them beside the scenario, and those that come with bussim among the built-in programs.

    ``folder`` is the scenario's; None: where the program was started. ``texts`` are those that were read,
    by the names that the scenario has for them; such a one is not read again.
    """

    def __init__(self, folder: Path | None, texts: dict[str, str] | None = None) -> None:
        self._folder = folder
        self.texts = {} if texts is None else texts

    def read(self, name: str, most: int) -> str:
        """The text of a file. Raises ValueError with a predicate for the user."""
        if name in self.texts:
            return self.texts[name]
        path = self._find(name)
        if path is None:
            where = "here" if self._folder is None else "beside the scenario"
            raise ValueError(f"is {shorten(name)}, but there is no such file {where}")
        try:
            with path.open("rb") as file:
                raw = file.read(most + 1)
        except OSError as error:
            raise ValueError(f"is {shorten(name)}, which cannot be read: {error.strerror or error}") from None
        if len(raw) > most:
            raise ValueError(f"is {shorten(name)}, which has more than {most >> 10} KiB")
        try:
            text = raw.decode("utf-8-sig")
        except UnicodeDecodeError as error:
            byte = raw[error.start]
            raise ValueError(
                f"is {shorten(name)}, which is no UTF-8 text (byte {error.start} is 0x{byte:02X})"
            ) from None
        self.texts[name] = text
        return text

    def _find(self, name: str) -> Path | None:
        places = [(self._folder or Path()) / name]
        if Path(name).name == name:
            places.append(builtin.folder() / "programs" / name)
        try:
            return next((path for path in places if path.is_file()), None)
        except (OSError, ValueError):
            return None
