"""The functions of the user that a scenario names: only with permission, as nothing else runs code."""

import importlib
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from bussim.words.language import say


class Code:
    """Finds ``module:function``. ``allowed``: the user has said --allow-code.

    Modules are looked for beside the scenario (``folder``), where the program was started, and then
    wherever Python finds its own; one that is loaded stays loaded. ``folders`` are those of the
    first two, as another process has them.
    """

    def __init__(
        self, *, allowed: bool = False, folder: Path | None = None, folders: tuple[str, ...] | None = None
    ) -> None:
        self.allowed = allowed
        if folders is None:
            here = (folder, Path.cwd()) if allowed else ()
            folders = tuple(str(folder.resolve()) for folder in here if folder is not None)
        self.folders = folders
        self._found: dict[str, Callable[[int], int]] = {}

    def find(self, name: str) -> Callable[[int], int]:
        """The function. Raises ValueError with a message for the user."""
        if not self.allowed:
            raise ValueError(say("user_not_allowed", name=name))
        if name not in self._found:
            self._found[name] = self._load(name)
        return self._found[name]

    def texts(self) -> dict[str, str]:
        """What the modules say whose functions were found, as far as they are written in Python."""
        import inspect

        found = {}
        for module in sorted({name.partition(":")[0] for name in self._found}):
            with suppress(OSError, TypeError, KeyError):  # it has no text, or none that is kept
                found[module] = inspect.getsource(sys.modules[module])
        return found

    def _load(self, name: str) -> Callable[[int], int]:
        module, _, function = name.partition(":")
        try:
            importlib.invalidate_caches()  # the file may be newer than this process
            with self._path():
                found = getattr(importlib.import_module(module), function, None)
        except ModuleNotFoundError as error:
            raise ValueError(say("user_no_module", name=name, module=error.name)) from None
        except (Exception, SystemExit) as error:  # whatever a user's module does when it is loaded
            what = f"{type(error).__name__}: {error}"[:200]
            raise ValueError(say("user_fails", name=name, module=module, what=what)) from None
        if not callable(found):
            what = say("user_has_no") if found is None else say("user_other")
            raise ValueError(say("user_function", name=name, module=module, what=what, function=function))  # noqa: TRY004
        return found  # type: ignore[no-any-return] # what it returns is checked whenever it is called

    @contextmanager
    def _path(self) -> Iterator[None]:
        added = [folder for folder in self.folders if folder not in sys.path]
        sys.path[:0] = added
        try:
            yield
        finally:
            for folder in added:
                if folder in sys.path:
                    sys.path.remove(folder)
