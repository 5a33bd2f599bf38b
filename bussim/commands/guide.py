"""``bussim guide``: the manual, in the terminal and without a network."""

import re
import sys
from importlib.resources import files
from importlib.resources.abc import Traversable

import click

from bussim.errors import UsageError
from bussim.words.tables import LANGUAGES

# Pages in the first language are complete, the folder of another one has some of its topics.

_MOST_COLUMNS = 110
#: Comments of a page are for those who write it.
_COMMENT = re.compile(r"<!--.*?-->\n?", re.DOTALL)
#: Topics listed before and after all others.
_FIRST, _LAST = "tutorial", "glossary"


@click.command()
@click.argument("topic", required=False)
@click.option(
    "--lang",
    "language",
    type=click.Choice(LANGUAGES),
    default=LANGUAGES[0],
    show_default=True,
    help="Language; topics that have no page in it are shown in English.",
)
def command(topic: str | None, language: str) -> None:
    """Show a page of the manual, or list the topics.

    In a terminal the page opens in its pager (less, or what PAGER names); into a file or a pipe goes the
    page's Markdown.
    """
    pages = topics(language)
    if topic is None:
        width = max(map(len, pages), default=0)
        for name, page in pages.items():
            click.echo(f"{name:{width}}  {heading(page)}")
        return
    if topic not in pages:
        from bussim.words.values import suggest

        raise UsageError(f"the guide has no topic {topic!r}; {suggest(topic, list(pages))}")
    if sys.stdout.isatty():
        click.echo_via_pager(_rendered(pages[topic]))
    else:
        click.echo(_COMMENT.sub("", pages[topic]), nl=False)


def topics(language: str = LANGUAGES[0]) -> dict[str, str]:
    """The Markdown of every topic by its name, in a language where there is a page in it, else in English."""
    guide = files("bussim") / "guide"
    pages = _pages(guide)
    if language != LANGUAGES[0]:
        pages |= _pages(guide / language)
    order = {_FIRST: -1, _LAST: 1}
    return dict(sorted(pages.items(), key=lambda page: (order.get(page[0], 0), page[0])))


def heading(page: str) -> str:
    """The first heading of a page, without the marks of Markdown."""
    match = re.search(r"^# +(.+)$", page, re.MULTILINE)
    return match[1].replace("`", "") if match else ""


def _pages(folder: Traversable) -> dict[str, str]:
    if not folder.is_dir():
        return {}
    return {
        file.name.removesuffix(".md"): file.read_text(encoding="utf-8")
        for file in folder.iterdir()
        if file.name.endswith(".md")
    }


def _rendered(page: str) -> str:
    """A page as it is shown in this terminal, escape sequences included."""
    from rich.console import Console
    from rich.markdown import Markdown

    console = Console(force_terminal=True)
    console.width = min(console.width, _MOST_COLUMNS)
    with console.capture() as capture:
        console.print(Markdown(_COMMENT.sub("", page), hyperlinks=False))
    return capture.get()
