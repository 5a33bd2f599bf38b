"""The files that a scenario names: programs, and tables of times."""

import errno
import itertools
import os
import re
from collections.abc import Mapping
from pathlib import Path

from bussim.files import kind_of
from bussim.scenario import builtin
from bussim.wording import nearest, shorten
from bussim.words.language import say
from bussim.words.tables import recognised

#: Names of a folder that are searched for the one that was meant.
_MOST_NAMES = 2000
#: Codings of programming tools, those of code pages in the order in which they are tried: few Japanese
#: texts are GB 2312 too.
_CODECS = {
    "UTF-8": "utf-8-sig",
    "UTF-16": "utf-16",
    "UTF-16LE": "utf-16-le",
    "UTF-16BE": "utf-16-be",
    "GB 2312": "gb2312",
    "Shift-JIS": "cp932",
    "GBK": "gbk",
    "Big5": "big5",
}
#: Katakana of half width alone, which Shift-JIS has in single bytes, and the common characters of GB 2312 in
#: two: a text that may be both is Chinese (every run of Katakana would have to be of even length).
_HALF_WIDTH = re.compile(rb"[\x00-\x7f\xa6-\xdf]*")
_COMMON_CHINESE = re.compile(rb"(?:[\x00-\x7f]|[\xb0-\xd7][\xa1-\xfe])*")

#: How files begin that hold other files: projects of GX Works and GX Developer, spreadsheets.
_PROJECTS = (b"\xd0\xcf\x11\xe0", b"PK\x03\x04")
#: What code pages make of bytes that mean nothing in them.
_UNASSIGNED = re.compile("[\x80-\x9f\ue000-\uf8ff]")


def _coding(raw: bytes) -> str:
    """The coding of a programming tool's text; UTF-8 where it is none of theirs."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return "UTF-16"
    if b"\0" in raw[:2]:
        return "UTF-16BE" if raw[0] == 0 else "UTF-16LE"
    names = [name for name in _CODECS if not name.startswith("UTF-16")]
    if _HALF_WIDTH.fullmatch(raw) and not _COMMON_CHINESE.fullmatch(raw):
        names.insert(1, "Shift-JIS")
    for name in names:
        try:
            if not _UNASSIGNED.search(raw.decode(_CODECS[name])):
                return name
        except UnicodeDecodeError:
            continue
    return "UTF-8"


class Files:
    """Finds them beside the scenario, and those that come with bussim among the built-in programs.

    ``folder`` is the scenario's; None: where the program was started. ``texts`` are those that were read,
    by the names that the scenario has for them; such a one is not read again. ``codings`` are those of the
    files of programming tools.
    """

    def __init__(self, folder: Path | None, texts: dict[str, str] | None = None) -> None:
        self._folder = folder
        self.texts = {} if texts is None else texts
        self.codings: dict[str, str] = {}

    def read(self, name: str, most: int, *, coded: bool = False) -> str:
        """The text of a file; ``coded``: a programming tool may have written it, in UTF-16 or a code page.

        Raises ValueError with a predicate for the user.
        """
        if name in self.texts:
            return self.texts[name]
        raw = self._raw(name, most)
        if coded and raw.startswith(_PROJECTS):
            what = say("file_project")
            raise ValueError(say("file_is", name=shorten(name), what=what))
        if len(raw) > most:
            raise ValueError(say("file_too_large", name=shorten(name), most=most >> 10))
        coding = _coding(raw) if coded else "UTF-8"
        try:
            text = raw.decode(_CODECS[coding])
        except UnicodeDecodeError as error:
            raise ValueError(say("file_is", name=shorten(name), what=_encoding(raw, error.start))) from None
        self.texts[name] = text
        self.codings[name] = "GBK" if coding == "GB 2312" else coding  # which holds all of it
        return text

    def _raw(self, name: str, most: int) -> bytes:
        """What is in a file, no more than a byte above ``most``; raises as :meth:`read`."""
        path = self._find(name)
        if path is None:
            raise ValueError(say("file_is", name=shorten(name), what=self._why_not(name)))
        try:
            with path.open("rb") as file:
                return file.read(most + 1)
        except OSError as error:
            raise ValueError(
                say("file_unreadable", name=shorten(name), strerror=error.strerror or error)
            ) from None

    def _find(self, name: str) -> Path | None:
        candidates = [(self._folder or Path()) / name]
        if Path(name).name == name:
            candidates.append(_programs() / name)
        try:
            return next((path for path in candidates if path.is_file()), None)
        except (OSError, ValueError):
            return None

    def _why_not(self, name: str) -> str:
        """Why a name is no file that can be read."""
        where = say("file_here") if self._folder is None else say("file_beside")
        path = (self._folder or Path()) / name
        try:
            mode = path.stat().st_mode
        except OSError as error:
            if error.errno == errno.ELOOP:
                return say("file_link_back")
            if path.is_symlink():
                return say("file_link_lost", path=shorten(str(path.readlink())))
            near = self._nearest(path)
            return say("file_missing", where=where, hint=_meant(near))
        except ValueError:  # a NUL in the name
            return say("file_missing", where=where, hint="")
        return say("file_kind", kind=recognised(kind_of(mode), "file_kind_of_"))

    def _nearest(self, path: Path) -> str | None:
        """The file in the same folder with the nearest name, of the same kind."""
        try:
            with os.scandir(path.parent) as entries:
                names = [entry.name for entry in itertools.islice(entries, _MOST_NAMES) if entry.is_file()]
        except OSError:
            names = []
        if self._folder is None or path.parent == self._folder:
            names += [entry.name for entry in _programs().iterdir()]
        alike = [other for other in names if Path(other).suffix.lower() == path.suffix.lower()]
        near = nearest(path.name, alike)
        return None if near is None else shorten(near)


class GivenFiles(Files):
    """Finds those that it is given, by name, and those that come with bussim; it reads no folder of the user.

    A message about a table quotes its lines: in a scenario of another author, no name may lead
    to a file of this computer.
    """

    def __init__(self, given: Mapping[str, bytes]) -> None:
        super().__init__(None)
        self._given = given

    def _raw(self, name: str, most: int) -> bytes:
        return self._given[name] if name in self._given else super()._raw(name, most)

    def _find(self, name: str) -> Path | None:
        return path if Path(name).name == name and (path := _programs() / name).is_file() else None

    def _why_not(self, name: str) -> str:
        near = nearest(name, [*self._given, *(entry.name for entry in _programs().iterdir())])
        return say("file_not_given", hint=_meant(near))


def _programs() -> Path:
    return builtin.folder() / "programs"


def _meant(near: str | None) -> str:
    return say("form_meant", meant=near) if near else ""


def _encoding(raw: bytes, position: int) -> str:
    """How bytes that are no UTF-8 are reported: where the first one is, and what to do."""
    if raw.startswith((b"\xff\xfe", b"\xfe\xff")):
        return say("file_utf16")
    before = raw[:position].replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    line = before.count(b"\n") + 1
    return say("file_no_utf8", line=line, byte=raw[position], codings=say("form_codings"))
