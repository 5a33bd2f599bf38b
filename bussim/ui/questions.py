"""What the page asks of a line, and the answers: each from the functions that ``import bussim`` offers."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field

from bussim.errors import UsageError
from bussim.exact.from_scenario import from_scenario
from bussim.exact.law_points import LawPoints
from bussim.exact.link import LinkModel
from bussim.exact.sizing.choice import choice_of
from bussim.exact.sizing.noise_levels import LEVELS
from bussim.exact.sizing.page.items import page_items
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.sized import Sized, size
from bussim.exact.solution import exact
from bussim.plc.profiles import MAX_RETRIES, attempts_per_poll
from bussim.report.sizing import sizing_page
from bussim.ui.guard import Refusal
from bussim.ui.line import Form, Line, Name, Strict, line_of, values_of
from bussim.ui.workspace import Workspace

#: Points of a curve: more than a screen can tell apart.
_POINTS = 300
#: Recommendations that are kept.
_KEPT = 16
#: What the page does not show of a sizing.
_LEFT_OUT = ("pareto", "pareto_above_1_s", "margins", "rests_on", "ladder")


class Asked(Strict):
    """A question on a line: its text, what the form changes of it, and which of its links is meant.

    ``beside`` is the id of the file that the text is of, ``lang`` the language of the sentences; ``n`` comes
    back with the answer.
    """

    text: Annotated[str, Field(max_length=4 * 1024 * 1024)]
    name: Name = "line.yaml"
    form: Form = Form()
    bus: Name = ""
    beside: Name | None = None
    without_faults: bool = False
    lang: Literal["en", "zh"] = "en"
    n: int = 0


class SizeAsked(Asked):
    """A question for a recommendation, with goals as ``bussim size --goal`` takes them."""

    goals: Annotated[tuple[Name, ...], Field(max_length=20, strict=False)] = ()


class Desk:
    """Answers questions on lines of a workspace, and remembers the recommendations it has worked out."""

    def __init__(self, workspace: Workspace) -> None:
        self.workspace = workspace
        self._sized: dict[tuple[object, ...], Sized] = {}

    def files(self, asked: Asked) -> dict[str, bytes]:
        """The files that a line may name."""
        return self.workspace.beside(asked.beside, asked.text)

    def line(self, asked: Asked) -> Line:
        """The line that a question is about. Raises ScenarioError with every mistake in it."""
        return line_of(asked.text, asked.form, asked.bus, asked.name, self.files(asked))

    def check(self, asked: Asked) -> dict[str, Any]:
        """The text with the form's changes, the form's values of it, and its warnings with their places."""
        line = self.line(asked)
        return {"text": line.text, "form": values_of(line), "warnings": _warnings(line), "n": asked.n}

    def law(self, asked: Asked) -> dict[str, Any]:
        """Figures of the link as ``bussim exact --json`` has them, and points of the distribution.

        With the warnings of the text. Where the noise is not known, the fan has the distribution at each of
        its assumed levels.
        """
        line = self.line(asked)
        found = exact(line.scenario, refresh=False, ignore_faults=asked.without_faults)
        answer: dict[str, Any] = {"n": asked.n, "form": values_of(line), "figures": None}
        answer["warnings"] = _warnings(line)
        if line.bus in found.links:
            answer["figures"] = found.links[line.bus].to_json()
            answer["law"] = _short(found.law_points(line.bus, points=_POINTS))
            fan = found.fan(line.bus, points=_POINTS)
            answer["fan"] = [
                {"level": key, "ber": LEVELS[key], "law": _short(law)} for key, law in fan.items()
            ]
        return answer

    def size(self, asked: SizeAsked) -> dict[str, Any]:
        """What ``bussim size --json`` recommends, and the figures of the setting as it is.

        ``rows`` are all numbers of retries at the line's timeout, with the goals that each misses; the last
        one is the line's own.
        """
        line = self.line(asked)
        try:
            sized = self.sized(asked, line)
        except Refusal:
            without = asked.model_copy(update={"goals": ()})
            if line.bus or (asked.goals and self.size(without)["ports"]):
                raise
            return {"n": asked.n, "sizing": None, "ports": {}}  # nothing in it can be sized
        ports = {
            node: {"recommended": each["recommended"], "reasons": each.get("reasons", [])}
            for node, each in ((node, found.to_json()) for node, found in sized.ports.items())
        }
        if not line.bus:
            return {"n": asked.n, "sizing": None, "ports": ports}
        sizing = sized.links[line.bus]
        model = from_scenario(line.scenario, ignore_faults=True, bound_end=True)[line.bus]
        return {
            "n": asked.n,
            "sizing": {key: value for key, value in sizing.to_json().items() if key not in _LEFT_OUT},
            "goals": [{"name": name, "text": text} for name, text in sizing.goals.texts().items()],
            "rows": rows_of(sizing, model),
            "ports": ports,
        }

    def sized(self, asked: SizeAsked, line: Line) -> Sized:
        """What ``bussim.size`` says of a line: the same for all of its D8179 and D8180."""
        form = asked.form.model_copy(update={"name": None, "retries": None, "timeout": None})
        files = tuple(self.files(asked).items())  # a program may be another one since
        key = (asked.text, form.model_dump_json(), asked.bus, files, tuple(asked.goals))
        found = self._sized.get(key)
        if found is None:
            try:
                goals = [each for each in asked.goals if line.bus or each.startswith("errors")]
                found = self._sized[key] = size(line.scenario, goals)
            except UsageError as error:
                raise Refusal(400, "goal", str(error)) from error
            for old in list(self._sized)[:-_KEPT]:
                self._sized.pop(old, None)
        return found

    def refresh(self, asked: Asked) -> dict[str, Any]:
        """How old the blocks of each pair may be, and the presets for a heartbeat."""
        line = self.line(asked)
        found = exact(line.scenario, ignore_faults=asked.without_faults).links
        gaps = found[line.bus].to_json()["refresh_gap_ms"] if line.bus in found else {}
        return {"n": asked.n, "refresh_gap_ms": gaps}

    def printed(self, asked: SizeAsked) -> str:
        """The sizing page of a line, which opens with the setting that is recommended."""
        line = self.line(asked)
        return sizing_page(line.scenario.name, page_items(self.sized(asked, line)), asked.lang)


def _warnings(line: Line) -> list[dict[str, Any]]:
    parts = ("file", "line", "column", "message")
    return [{part: getattr(each, part) for part in parts} for each in line.warnings]


def _short(law: LawPoints) -> LawPoints:
    """Points with as many digits as a screen can show."""
    return LawPoints([round(x, 4) for x in law.x], [float(f"{y:.5g}") for y in law.y])


def rows_of(sizing: Sizing, model: LinkModel) -> list[dict[str, Any]]:
    """All numbers of attempts at the timeout of a link, and the link's own setting as the last one.

    Empty where the setting is none that a recommendation can have (a reply does not fit its timeout).
    """
    checked = sizing.checked
    if checked is None or model.timeout not in checked.grid.timeouts:
        return []
    grid = checked.grid
    column = grid.timeouts.index(model.timeout)
    if not bool(grid.valid[column]):
        return []
    lowest: dict[int, int] = {}
    for retries in range(MAX_RETRIES + 1):
        lowest.setdefault(attempts_per_poll(model.reading, retries), retries)
    rows: list[dict[str, Any]] = []
    for retries in (*lowest.values(), model.retries):
        choice = choice_of(grid, model.reading, retries, model.timeout)
        row = grid.attempts.index(choice.attempts)
        missed = [name for name, met in checked.met.items() if not met[row, column]]
        rows.append({**choice.to_json(), "misses": missed})
    if not checked.heartbeat_met(row, column):  # which takes a distribution for each setting
        rows[-1]["misses"].append("heartbeat")
    return rows
