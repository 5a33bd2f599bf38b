"""How the values of a text are written.

Beside the formats of Python a text of the tables knows ``n`` (a whole number with its thousands apart),
``counted frame`` (a number with its noun), ``ms`` and ``most_ms`` (milliseconds, see
:func:`bussim.wording.in_ms`), ``list`` (names, "and" before the last), ``either`` (names with "or" between),
``listed``, ``joined``, ``spaced`` and ``plus`` (texts between commas, semicolons, blanks or +), ``station``
(a station by number and name), ``counts`` (words with how often), ``codes`` and ``exceptions`` (counts by
code, with what each means), ``meanings`` (what codes mean), ``cause`` and ``brief`` (why a link scan was
long), ``reason`` and ``reasons`` (why frames were refused or attempts failed, and how often), ``frame`` and
``message`` (a kind of frame, what became of messages), ``line`` (where in a program), ``when`` (how often,
for how long, and when longest), ``times`` (of responses, or nothing), ``part`` (the text of another key),
``devices`` (special devices of the link by name) and ``serial`` (a code of D8063).
"""

import re
from collections.abc import Iterable, Mapping
from string import Formatter
from typing import Any

from bussim.wording import counted, in_ms
from bussim.words.tables import LANGUAGES, Said, entries, keys_of

#: Error codes are in D8211 to D8218, of an FX1S in D211 to D218; counts lie below.
_FIRST_CODE = 11
#: What stands between texts.
_BETWEEN = {"listed": "comma", "joined": "semicolon", "spaced": "space"}
#: The 7 of 7xyy, PW10's codes in D8063 (its board manual, section 8).
_PW10 = 7
_STATION = re.compile(r"station (\d+)(?: \((.*)\))?", re.DOTALL)
_LINE = re.compile(r"at line (\d+)( of the program)?")
_GIVEN_UP = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) attempts?, (?:all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)
_REPLIED_LATE = re.compile(r"(station \d+(?: \(.*\))?) replied (\S+ \S+) after its poll")
_REPEATED = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) failed attempts? before the (?:answer|reply), "
    r"(?:all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)


def render(key: str, values: Mapping[str, Any] | None = None, lang: str = "en") -> str:
    """The text of a key with its values in a language. Raises KeyError where there is no such key."""
    text = TextFormatter(lang).vformat(entries()[key][LANGUAGES.index(lang)], (), values or {})
    return text[:1].upper() + text[1:] if text.endswith(".") and text.startswith("station ") else text


def meaning(code: str, lang: str = "en", *, kind: str = "code") -> str:
    """What two digits mean, in words: a ``code`` of the N:N link, an ``exception``, a ``port_error``."""
    said = meaning_of(code, kind=kind)
    return render(said.key, said.values, lang)


def meaning_of(code: str, *, kind: str = "code") -> Said:
    """As :func:`meaning`, in every language."""
    key = f"{kind}_{code}"
    key = key if key in entries() else f"{kind}_other"
    return Said(render(key, {"code": code}), key, {"code": code})


def cause_in_words(cause: str, lang: str = "en") -> str:
    """The cause of a link scan in ``summary.json`` as the part of a sentence after "because"."""
    return render("cause_and", lang=lang).join(_reason(reason, lang) for reason in cause.split("; "))


def _reason(reason: str, lang: str) -> str:
    if found := _GIVEN_UP.fullmatch(reason):
        station, number, codes = found.groups()
        key = "long_only_failed" if number == "1" else "long_all_failed"
        return render(key, {"station": station, "number": int(number), "codes": codes}, lang)
    if found := _REPEATED.fullmatch(reason):
        station, number, codes = found.groups()
        return render("long_repeated", {"station": station, "number": int(number) + 1, "codes": codes}, lang)
    if found := _REPLIED_LATE.fullmatch(reason):
        station, time = found.groups()
        return render("long_late", {"station": station, "time": time}, lang)
    return render("long_parameters", lang=lang) if reason == "parameter frame" else reason


class TextFormatter(Formatter):
    """Writes the values of a text in a language."""

    def __init__(self, lang: str) -> None:
        self._lang = lang

    def format_field(self, value: Any, format_spec: str) -> str:
        """See :mod:`bussim.words.formats`."""
        if isinstance(value, Said):
            return self._shown(value)
        match format_spec:
            case "" if isinstance(value, list):
                return "".join(map(self._shown, value))
            case "n":
                return f"{value:,}" if not isinstance(value, str) else value
            case "ms" | "most_ms" if not isinstance(value, str):
                return in_ms(value, most=format_spec == "most_ms")
            case "list":
                *others, last = map(self._shown, value)
                return self._part("and").join([self._part("comma").join(others), last] if others else [last])
            case "either":
                return self._part("form_or").join(map(self._shown, value))
            case "listed" | "joined" | "spaced" | "plus":
                between = " + " if format_spec == "plus" else self._part(_BETWEEN[format_spec])
                return between.join(map(self._shown, value)) if not isinstance(value, str) else value
            case "station":
                return self._shown(value)
            case "line":
                at = _LINE.fullmatch(value)
                key = "line_of_program" if at is not None and at[2] else "line_at"
                return value if at is None else render(key, {"line": at[1]}, self._lang)
            case "when":
                if value is None:  # in a folder of an earlier version
                    return self._part("times_unknown")
                several, lasts = value["times"] > 1, value["for_s"]
                key = "several_times" if lasts else "apart"
                return render(key if several else "once" if lasts else "at_once", value, self._lang)
            case "times":
                which = "" if value["max"] is None else "mean" if value["p50"] is None else "median"
                return which and render(f"{which}_times", value, self._lang)
            case "part":
                return self._part(value)
            case "devices":
                return self._listed(self._device(name, number) for name, number in value.items())
            case "serial":
                port, error = divmod(value % 1000, 100)
                if value // 1000 != _PW10:
                    return str(value)
                what = meaning_of(f"{error:02}", kind="port_error")
                return render("serial_code", {"code": value, "port": port, "meaning": what}, self._lang)
            case "counts":
                return self._listed(f"{self._shown(what)} {number:,}×" for what, number in value.items())
            case "codes" | "exceptions":
                kind = "code" if format_spec == "codes" else "exception"
                found = (
                    {"code": code, "number": number, "meaning": meaning_of(code, kind=kind)}
                    for code, number in value.items()
                )
                return self._listed(render("code_times", each, self._lang) for each in found)
            case "meanings":
                words = dict.fromkeys(meaning(code, self._lang) for code in value.split(", "))
                return self._part("then").join(words)
            case "cause":
                return cause_in_words(value, self._lang)
            case "brief":
                return str(value) if self._lang == "en" else cause_in_words(value, self._lang)
            case "reason":
                return self._reason(value)
            case "frame" | "message":
                key = f"{'kind' if format_spec == 'frame' else 'message_word'}_{value}"
                return self._part(key) if key in entries() else str(value)
            case "reasons":
                return self._listed(f"{self._reason(what)} {number:,}×" for what, number in value.items())
            case _ if format_spec.startswith("counted "):
                return value if isinstance(value, str) else counted(value, format_spec.partition(" ")[2])
            case _ if isinstance(value, str) and format_spec:
                return value  # of a text that a file kept
            case _:
                return "–" if value is None else str(super().format_field(value, format_spec))

    def _part(self, key: str) -> str:
        return render(key, lang=self._lang)

    def _listed(self, texts: Iterable[str]) -> str:
        return self._part("comma").join(texts)

    def _shown(self, text: str) -> str:
        """A part of a text; what a station is called by its number is so in the other language, too."""
        if self._lang == "en":
            return text
        if found := _STATION.fullmatch(text):
            number, plc = found.groups()
            key = "station" if plc else "station_number"
            return render(key, {"number": number, "plc": plc}, self._lang)
        if isinstance(text, Said) or text == render("program"):
            key, values = (text.key, text.values) if isinstance(text, Said) else ("program", {})
            return render(key, values, self._lang)
        return text

    def _reason(self, text: str) -> str:
        """Why a frame was refused, which a summary has in English."""
        tables = map(keys_of, ("reason_", "port_error_", "outcome_"))
        key = next((keys[text] for keys in tables if text in keys), None)
        return text if key is None or self._lang == "en" else self._part(key)

    def _device(self, name: str, number: int) -> str:
        """A special device and what it holds; an error code in hexadecimal digits, with its meaning."""
        if name.startswith("M"):
            return render("device_on", {"name": name}, self._lang)
        if int(name[-2:]) < _FIRST_CODE:
            return f"{name} = {number:,}"
        code = f"{number:02X}"
        values = {"name": name, "code": code, "meaning": meaning_of(code)}
        return render("device_code", values, self._lang)
