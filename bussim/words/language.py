"""The language that is used, and texts in it.

The program makes each text in English (:func:`say`) and keeps key and values with it, so that JSON and files
are the same in every language; what prints, draws or writes a page shows it in the language that is used
(:func:`shown`).
"""

import os
import sys
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import replace
from typing import Any, overload

from bussim.errors import Problem, UsageError
from bussim.words.formats import render
from bussim.words.tables import LANGUAGES, Said

_language: ContextVar[str] = ContextVar("language", default="en")


def say(key: str, /, **values: Any) -> str:
    """The text of a key in English, a :class:`Said`. Raises KeyError where there is no such key."""
    return Said(render(key, values), key, values)


def said_text(key: str, /, **values: Any) -> str:
    """The text of a key in the language that is used. Raises KeyError where there is no such key."""
    return render(key, values, _language.get())


@overload
def shown(text: str) -> str: ...
@overload
def shown(text: Any) -> Any: ...
def shown(text: Any) -> Any:
    """A text in the language that is used, as far as it knows its key; of lists and mappings each text.

    Of a mistake or a warning of a file its message.
    """
    if isinstance(text, Said):
        lang = _language.get()
        return str(text) if lang == "en" else render(text.key, text.values, lang)
    if isinstance(text, Problem):
        return replace(text, message=shown(text.message))
    if isinstance(text, Mapping):
        return {shown(key): shown(value) for key, value in text.items()}
    if isinstance(text, list | tuple):
        return [shown(each) for each in text]
    return text


def choose_language(lang: str) -> None:
    """Use a language of :data:`~bussim.words.tables.LANGUAGES` in this context from now on."""
    _language.set(lang)


@contextmanager
def use_language(lang: str) -> Iterator[None]:
    """Use a language of :data:`~bussim.words.tables.LANGUAGES` meanwhile; UsageError for another one."""
    if lang not in LANGUAGES:
        raise UsageError(f"the language is {lang!r}, allowed are {' and '.join(LANGUAGES)}")
    token = _language.set(lang)
    try:
        yield
    finally:
        _language.reset(token)


def current_language() -> str:
    """The language that is used: English unless :func:`use_language` says otherwise."""
    return _language.get()


def system_language() -> str:
    """The language of this system: Chinese, else English.

    LC_ALL, LC_MESSAGES or LANG name it; on Windows, where none does, the language of its windows.
    """
    named = next(filter(None, (os.environ.get(name) for name in ("LC_ALL", "LC_MESSAGES", "LANG"))), "")
    if not named and sys.platform == "win32":
        import ctypes
        import locale

        named = locale.windows_locale.get(ctypes.windll.kernel32.GetUserDefaultUILanguage(), "")
    return "zh" if named.lower().startswith("zh") else "en"
