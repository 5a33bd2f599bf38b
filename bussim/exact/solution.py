"""``bussim.exact``: everything that is known of a scenario without simulating it."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import asdict, dataclass, field
from os import PathLike
from typing import TYPE_CHECKING

from bussim.exact.from_scenario import from_scenario
from bussim.exact.law_points import LawPoints, law_points
from bussim.exact.metrics import Figures, Request, figures_of
from bussim.exact.periods import Period, periods_of
from bussim.exact.sizing.assumptions import rests_on
from bussim.exact.sizing.noise_levels import LEVELS, with_level
from bussim.exact.solve import Solved
from bussim.exact.text import ms_cell
from bussim.scenario import loader
from bussim.scenario.model import Scenario
from bussim.scenario.provenance import ASSUMED
from bussim.units import TICKS_PER_SECOND

if TYPE_CHECKING:
    import pandas as pd

    from bussim.exact.latency.bounds import LatencyBound
    from bussim.exact.polls.metrics import PollFigures

#: Called with what is worked out, how much of it is done, and how much there is.
Progress = Callable[[str, int, int], None]
_LEVELS = ("1e-3", "1e-6", "1e-9")


@dataclass(frozen=True, slots=True, repr=False)
class Exact:
    """What ``bussim exact`` says of a scenario; :meth:`to_dict` is its JSON form.

    ``links`` are by bus, ``polls`` by master (``press1.COM3``, or a device), ``latency`` by entry; times in
    ticks of 1/72 MHz there, in ms in :meth:`to_dict`. ``periods`` has the links for which a fault comes or
    goes, before, during and after it.
    """

    scenario: Scenario
    links: dict[str, Figures]
    polls: dict[str, PollFigures]
    latency: Mapping[str, LatencyBound]
    periods: dict[str, list[tuple[Period, Figures]]] = field(default_factory=dict)

    def __repr__(self) -> str:
        said = [
            f"{bus}: mean {ms_cell(each.mean)} ms, worst case {ms_cell(each.worst_case)} ms"
            for bus, each in self.links.items()
        ]
        return f"<Exact of {self.scenario.name!r}: {'; '.join([*said, *self.polls, *self.latency])}>"

    def to_dict(self) -> dict[str, object]:
        """The JSON form, times in ms."""
        links = {bus: _json(figures) for bus, figures in self.links.items()}
        for bus, each in self.periods.items():
            links[bus]["periods"] = [
                {**period.to_json(TICKS_PER_SECOND), **_json(figures)} for period, figures in each
            ]
        lists = {node: figures.to_json() for node, figures in self.polls.items()}
        result: dict[str, object] = {"schema": 1, "links": links, "polls": lists}
        if self.scenario.carried:
            result["warnings"] = [asdict(each) for each in self.scenario.carried]
        if self.latency:
            result["latency"] = {name: bound.to_json() for name, bound in self.latency.items()}
        # As times of ports and programs are.
        result["rests_on"] = dict.fromkeys(("polls", "latency"), ASSUMED)
        return result

    def law_points(self, bus: str, *, least: float = 1e-9, points: int = 1_300) -> LawPoints:
        """At most ``points`` points of P(link scan > x) for a drawing, x in ms, down to ``least``.

        Lines between them on a logarithmic axis keep the steps of the distribution. There is none where the
        figures of the link are not valid.

        Raises KeyError for what is no link, ValueError for ``least`` beyond 0 and 1 and for under two points.
        """
        law = self.links[bus].distribution
        return LawPoints([], []) if law is None else law_points(law, least, points)

    def fan(self, bus: str, *, least: float = 1e-9, points: int = 1_300) -> dict[str, LawPoints]:
        """The same at each level of noise that is assumed where none is entered: quiet, typical and bad.

        Empty where the noise is entered or the figures are not valid.
        """
        figures = self.links[bus]
        if figures.model.noisy or not figures.valid:
            return {}
        models = {name: with_level(figures.model, ber) for name, ber in LEVELS.items()}
        return {
            name: law_points(Solved(model).distribution, least, points)
            for name, model in models.items()
            if model.valid
        }

    def table(self) -> pd.DataFrame:
        """The figures of the links that are single numbers, one row a link, times in ms."""
        import pandas as pd

        rows = {bus: _json(figures) for bus, figures in self.links.items()}
        kept = {
            bus: {
                key: value for key, value in row.items() if value is None or isinstance(value, (int, float))
            }
            for bus, row in rows.items()
        }
        return pd.DataFrame.from_dict(kept, orient="index")


def between_faults(scenario: Scenario) -> dict[str, Figures]:
    """Figures of each N:N link, without the ages of blocks; of one with faults those of the time between."""
    undisturbed = from_scenario(scenario, ignore_faults=True)
    return {
        bus: figures_of(model if model.valid else undisturbed[bus], Request(refresh=False))
        for bus, model in from_scenario(scenario).items()
    }


def exact(
    scenario: Scenario | str | PathLike[str],
    *,
    levels: Iterable[str] = _LEVELS,
    deadlines: Iterable[int] = (),
    mission: int | None = None,
    refresh: bool = True,
    ignore_faults: bool = False,
    progress: Progress | None = None,
) -> Exact:
    """Work out link scan times, poll cycles and latencies of a scenario, given as such, as a file or by name.

    ``levels`` are the probabilities of exceeding at which quantiles are asked for, as texts, ``deadlines``
    times in ticks of 1/72 MHz whose exceeding is, ``mission`` the time in ticks in which the longest scan is
    asked for (None: a year). Without ``refresh`` the ages of the blocks, which take longest, are left out;
    with ``ignore_faults`` what acts only for a part of the run.

    Raises ScenarioError or UsageError for a scenario that cannot be loaded; ValueError for a level that is
    no number.
    """
    loaded = scenario if isinstance(scenario, Scenario) else loader.load(scenario)
    asked = Request(
        levels={text: float(text) for text in levels}, deadlines=tuple(deadlines), refresh=refresh
    )
    if mission is not None:
        asked = Request(levels=asked.levels, deadlines=asked.deadlines, mission=mission, refresh=refresh)
    models = from_scenario(loaded, ignore_faults=ignore_faults)
    found = {bus: figures_of(model, asked, progress) for bus, model in models.items()}
    periods = {}
    if not all(figures.valid for figures in found.values()):
        periods = {
            bus: [(period, figures_of(period.model, asked, progress)) for period in each]
            for bus, each in periods_of(loaded).items()
            if len(each) > 1 or each[0].model.valid
        }
    return Exact(loaded, found, _polls(loaded), _latency(loaded), periods)


def _json(figures: Figures) -> dict[str, object]:
    values = figures.to_json()
    return {**values, "rests_on": rests_on(figures.model, values)}


def _polls(scenario: Scenario) -> dict[str, PollFigures]:
    if not (scenario.devices or any(plc.polls or plc.program for plc in scenario.plcs)):
        return {}
    from bussim.exact.polls.from_scenario import poll_lists
    from bussim.exact.polls.metrics import poll_figures

    return {node: poll_figures(model) for node, model in poll_lists(scenario).items()}


def _latency(scenario: Scenario) -> Mapping[str, LatencyBound]:
    if not scenario.latency:
        return {}
    from bussim.exact.latency.bounds import bounds_of

    return bounds_of(scenario)
