"""The scenarios that come with bussim."""

from pathlib import Path

from bussim.errors import UsageError
from bussim.wording import shorten
from bussim.words.values import suggest

#: What ``bussim run`` runs when it is given nothing.
DEFAULT = "press_line"

# In a wheel the files lie beside this module, in a checkout in the repository's own folder.
_FOLDERS = (Path(__file__).with_name("builtin"), Path(__file__).parents[2] / "scenarios")


def folder() -> Path:
    """Where they lie; their programs are in ``programs`` below. Raises UsageError if they are missing."""
    for folder in _FOLDERS:
        if (folder / f"{DEFAULT}.yaml").is_file():
            return folder
    raise UsageError("the built-in scenarios are missing from this installation of bussim")


def names() -> list[str]:
    """The names of the built-in scenarios, the default one first, the others by name."""
    found = sorted(file.stem for file in folder().glob("*.yaml"))
    return sorted(found, key=lambda name: name != DEFAULT)


def path(name: str) -> Path:
    """The file of a built-in scenario. Raises UsageError, with the nearest name, if there is none."""
    known = names()
    wanted = name.removesuffix(".yaml")
    if wanted not in known:
        raise UsageError(f"no built-in scenario {shorten(repr(name))}; {suggest(wanted, known)}")
    return folder() / f"{wanted}.yaml"


def read(name: str) -> str:
    """The text of a built-in scenario."""
    return path(name).read_text(encoding="utf-8")


def title(name: str) -> str:
    """Its first line, without the comment sign."""
    return read(name).partition("\n")[0].lstrip("# ").rstrip()


def locate(scenario: str | Path) -> tuple[Path, str]:
    """The file that an argument means and the name for messages: an existing file, else a built-in name."""
    given = Path(scenario)
    text = str(scenario)
    try:
        exists = given.is_file()
    except (OSError, ValueError):
        exists = False
    known = names()
    if not exists and given.name == text and text.removesuffix(".yaml") in known:
        found = path(text)
        return found, found.name
    return given, text
