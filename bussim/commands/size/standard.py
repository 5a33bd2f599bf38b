"""The sizing page of the usual links: 2 to 8 stations, refresh modes 0 to 4."""

from bussim.commands.size.uniform_link import DEFAULT_PROFILE, uniform_link
from bussim.exact.sizing.page.items import Detail, page_items
from bussim.exact.sizing.sized import size
from bussim.plc.profiles import MAX_SLAVES, PROFILES
from bussim.report.sizing import sizing_page

#: What the page has of each of so many lines, and the line that it opens with.
_DETAIL = Detail(timeouts=6, points=16)
_FIRST = 4, 2


def standard_page(
    goals: tuple[str, ...],
    lang: str,
    *,
    profile: str | None = None,
    scan: str | None = None,
    ber: float | None = None,
    overrides: tuple[str, ...] = (),
) -> str:
    """The page, with what each link is given as ``bussim size --stations N --mode M`` is.

    Raises UsageError as that does.
    """
    name = profile or DEFAULT_PROFILE
    stations = range(2, MAX_SLAVES + 2)
    modes = PROFILES[name].modes if name in PROFILES else (0,)  # another name is refused below
    items = [
        item
        for count in stations
        for mode in modes
        for item in page_items(
            size(uniform_link(count, mode, profile=name, scan=scan, ber=ber, overrides=overrides), goals),
            _DETAIL,
        )
    ]
    dims = [
        {"key": key, "values": list(values), "start": list(values).index(first) if first in values else 0}
        for key, values, first in zip(("stations", "mode"), (stations, modes), _FIRST, strict=True)
    ]
    return sizing_page("", items, lang, dims)
