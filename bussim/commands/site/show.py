"""What ``bussim site`` prints."""

from collections.abc import Mapping
from math import ceil
from statistics import median

from rich.console import Console

from bussim.commands.common.console import plain_table, print_line
from bussim.plc.profiles import Attempts
from bussim.site.calibration import Found
from bussim.site.diagnosis.causes import MEANINGS
from bussim.site.diagnosis.diagnose import Diagnosis
from bussim.site.noise.picture import Picture
from bussim.site.noise.sizing import sizes
from bussim.site.plan import EVENTS, expected_failures, plan
from bussim.site.readout import Readout
from bussim.site.result import SiteResult

#: Causes whose evidence is printed.
_SHOWN = 3


def show_readout(console: Console, found: SiteResult, *, planned: bool) -> None:
    """Print what is wrong, how much noise there is, and if ``planned`` how long to watch for it."""
    assert found.diagnosis and found.pictures and isinstance(found.noted, Readout)  # noqa: S101, PT018 - of a readout
    show_diagnosis(console, found.noted, found.diagnosis)
    for meaning, one in found.pictures.items():
        show_picture(console, found.noted, one, meaning, mend_first=found.diagnosis.broken)
    if planned:
        show_plan(console, next(iter(found.pictures.values())))


def show_diagnosis(console: Console, readout: Readout, found: Diagnosis) -> None:
    """Print the likeliest causes with their evidence, and the next reading."""
    for note in readout.notes:
        print_line(console, f"note: {note}", 0)
    print_line(console, "what is wrong", 0, "bold")
    if not found.causes:
        print_line(console, "nothing in these readings points to a cause")
    for index, cause in enumerate(found.causes[:_SHOWN], 1):
        at = readout.label(cause.station)
        text = f"{index}. {MEANINGS[cause.cause].format(at=at)} ({cause.score:.1f} points)"
        print_line(console, text, style="bold" if index == 1 else "")
        for why in cause.evidence:
            print_line(console, why, 5)
    if found.close:
        names = ", ".join(one.cause.value.replace("_", " ") for one in (found.causes[0], *found.close))
        print_line(console, f"these readings cannot tell apart, or more than one is there: {names}")
    for text in found.next:
        print_line(console, f"next: {text}")


def show_picture(
    console: Console, readout: Readout, found: Picture, meaning: Attempts | None, *, mend_first: bool
) -> None:
    """Print how much noise there is, where, what it rests on, and what ``bussim size`` makes of it."""
    measured, link = found.measured, found.link
    read_as = "" if meaning is None else f", if D8179 means {meaning} (the calibration left it open)"
    print_line(console, f"how much noise, and where{read_as}", 0, "bold")
    if mend_first:
        print_line(console, "mend the cause above first: what follows counts its failures too")
    least, _, most = measured.scans
    print_line(console, f"link scans watched: {least:,.0f} to {most:,.0f}")
    table = plain_table(("station", "limited by"), ("attempts that fail", "95 % interval"))
    for k, fails in found.fails.items():
        value = f"{fails.value:.2g}" if fails.value else ""
        table.add_row(readout.label(k), fails.lens, value, f"{fails.low:.2g} … {fails.high:.2g}")
    console.print(table)
    table = plain_table(("lens", "reading", "tells", "rests on"), ("value", "95 % interval"))
    for lens in measured.lenses:
        value = f"{lens.value:.2g}" if lens.count else ""
        limits = f"{lens.low:.2g} … {lens.high:.2g}" if lens.count else f"below {lens.high:.2g}"
        table.add_row(lens.name, lens.reading, lens.tells, lens.rests_on, value, limits)
    if measured.lenses:
        console.print(table)
    for text in found.unexplained:
        print_line(console, f"unexplained: {text}")
    print_line(console, f"bursts: {found.bursts}")
    print_line(console, "noise:")
    for entry in found.entries():
        print_line(console, f"- {flow(entry)}", 4)
    for entry in found.upper.entries(link.names):
        print_line(console, f"# at most: {flow(entry)}", 4)
    for text in found.unknown:
        print_line(console, f"# not known: {text}", 4)
    chosen = sizes(found)
    print_line(console, f"bussim size by these values: {chosen['likeliest'].in_words()}")
    print_line(console, f"bussim size by the upper limits: {chosen['upper_limits'].in_words()}")


def show_plan(console: Console, found: Picture) -> None:
    """Print how long to watch with which reading, and the ladder's thresholds."""
    fails, limit = expected_failures(found)
    guess = f"{'the upper limit' if limit else 'the value'} {median(fails):.2g} of failed attempts"
    print_line(console, f"how long for {EVENTS} events, by {guess}", 0, "bold")
    for watch in plan(found):
        print_line(console, watch.in_words())
    a, b, c = (ceil(each) for each in found.link.thresholds())
    print_line(console, f"the ladder's thresholds: {a}, {b}, {c} (least D8201 that counts)")


def show_calibration(console: Console, found: Found, profile: str) -> None:
    """Print what experiments decide of a profile, what they leave open, and what no rule explains."""
    print_line(console, "what the experiments decide", 0, "bold")
    for name, decided in found.fields.items():
        print_line(console, f"{name}: {decided}")
    for name, (value, low, high) in found.times.items():
        print_line(console, f"{name}: {value:.2f} ms, by the rounding {low:.2f} to {high:.2f} ms")
    for name, why in found.open.items():
        print_line(console, f"open: {name} ({why}); the profile keeps what is assumed")
    for text in found.checked:
        print_line(console, f"checked: {text}")
    for text in found.unexplained:
        print_line(console, f"the model is wrong here: {text}", style="bold")
    print_line(console, "no profile is written of this" if found.unexplained else "the profile:")
    for text in profile.splitlines():
        print_line(console, text, 4)


def flow(entry: Mapping[str, object]) -> str:
    """An entry of a scenario on one line."""
    values = ((key, f"{value:.3g}" if isinstance(value, float) else value) for key, value in entry.items())
    return "{" + ", ".join(f"{key}: {value}" for key, value in values) + "}"
