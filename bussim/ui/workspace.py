"""The one folder that the page may read scenarios from and write them to, by numbers of its listing."""

from __future__ import annotations

import itertools
import re
from contextlib import suppress
from hashlib import sha256
from pathlib import Path
from typing import Any

from bussim.errors import RunError, UsageError
from bussim.files import reading, written_whole
from bussim.scenario import builtin
from bussim.scenario.yaml.parser import MAX_BYTES
from bussim.ui.guard import Refusal

#: Files that are listed or that a scenario names, and the most bytes of such a one.
_MOST_FILES, _MOST_NAMED = 500, 4 * 1024 * 1024
_NAME = re.compile(r"[^\\/:*?\"<>|\x00-\x1f\x7f.][^\\/:*?\"<>|\x00-\x1f\x7f]{0,99}\.ya?ml", re.IGNORECASE)


class Workspace:
    """A folder with scenarios. ``opened`` is the scenario that the page begins with, None for the example."""

    def __init__(self, folder: Path, opened: Path | None = None) -> None:
        self.folder = folder.resolve()
        self.opened = opened
        self._listed: dict[str, Path] = {}
        self._numbers = itertools.count(1)

    def listing(self) -> list[dict[str, str]]:
        """The scenarios of the folder and those that come with bussim; the ids are of this listing on.

        Raises UsageError where the folder cannot be read.
        """
        with reading(self.folder):
            found = sorted(
                path for path in self.folder.iterdir() if _NAME.fullmatch(path.name) and self._plain(path)
            )
        rows = [{"id": self.number(path), "name": path.name, "kind": "file"} for path in found[:_MOST_FILES]]
        for name, title in [(name, builtin.title(name)) for name in builtin.names()]:
            path = builtin.folder() / f"{name}.yaml"
            rows.append({"id": self.number(path), "name": name, "kind": "built-in", "about": title})
        return rows

    def number(self, path: Path) -> str:
        """The id of a path, the same whenever it is listed."""
        known = next((key for key, each in self._listed.items() if each == path), None)
        key = known or str(next(self._numbers))
        self._listed[key] = path
        return key

    def path(self, key: str) -> Path:
        """The path of an id. Raises Refusal for one that no listing has."""
        if key not in self._listed:
            raise Refusal(400, "unknown_id", "the list has no such entry; look at it again")
        return self._listed[key]

    def read(self, path: Path) -> dict[str, Any]:
        """A scenario's text, its name, its id and its hash. Raises Refusal for what cannot be read."""
        try:
            with path.open("rb") as file:
                raw = file.read(MAX_BYTES + 1)
            text = raw.decode("utf-8")
        except (OSError, UnicodeDecodeError):
            said = f"{path.name} cannot be read: it is gone, or it is no text in UTF-8"
            raise Refusal(400, "unreadable", said, {"name": path.name}) from None
        if len(raw) > MAX_BYTES:
            raise Refusal(413, "too_large", f"a scenario has at most {MAX_BYTES:,} bytes")
        own = path.parent.resolve() == self.folder  # whatever way leads there
        return {"text": text, "name": path.name, "id": self.number(path), "hash": _hash(raw) if own else None}

    def save(self, name: str, text: str, expected: str | None) -> dict[str, Any]:
        """Write a scenario whose file still is what the page has read (``expected``, None: is not there).

        Raises Refusal for a name that is none of a YAML file here, 409 where the file is another one, and
        UsageError where what is there cannot be read.
        """
        path = self.folder / name
        with reading(path):
            if not _NAME.fullmatch(name) or (path.is_symlink() and not self._plain(path)):
                raise Refusal(400, "name", "a file's name here is plain and ends in .yaml", {"name": name})
            found = _hash(path.read_bytes()) if path.exists() else None
        if found != expected:
            raise Refusal(409, "conflict", f"{name} was changed by another program", {"name": name})
        raw = text.encode("utf-8")
        try:
            with written_whole(path) as part:
                part.write_bytes(raw)
        except (UsageError, RunError) as error:
            raise Refusal(400, "unwritable", str(error), {"name": name}) from error
        return {"name": name, "id": self.number(path), "hash": _hash(raw), "text": text}

    def beside(self, key: str | None, text: str) -> dict[str, bytes]:
        """The files that a scenario's text may name: plain ones beside the file of an id, else those here.

        No name and no link leads out of their folder.
        """
        folder = self.folder if key is None else self.path(key).parent.resolve()
        found: dict[str, bytes] = {}
        try:
            named = sorted(path for path in folder.iterdir() if path.name in text)
        except OSError:
            return found  # nothing lies in a folder that is gone
        for path in named[:_MOST_FILES]:
            with suppress(OSError):
                if path.is_file() and path.resolve().parent == folder:
                    with path.open("rb") as file:
                        found[path.name] = file.read(_MOST_NAMED)
        return found

    def _plain(self, path: Path) -> bool:
        """Whether it is a plain file that no link leads out of the folder."""
        return path.is_file() and path.resolve().is_relative_to(self.folder)


def _hash(raw: bytes) -> str:
    return sha256(raw).hexdigest()
