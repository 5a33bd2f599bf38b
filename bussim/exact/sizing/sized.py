"""``bussim.size``: the settings that the links and poll lists of a scenario should have."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import asdict, dataclass
from os import PathLike
from typing import TYPE_CHECKING

from bussim.errors import UsageError
from bussim.exact.from_scenario import from_scenario
from bussim.exact.sizing.goals import LINK_GOALS, PORT_GOALS, Goals
from bussim.exact.sizing.ports.size import PortSizing, size_ports
from bussim.exact.sizing.size import Sizing
from bussim.exact.sizing.size import size as size_link
from bussim.exact.text import ms
from bussim.scenario import loader
from bussim.scenario.model import Scenario
from bussim.units import TICKS_PER_MS
from bussim.wording import names
from bussim.words.values import suggest

if TYPE_CHECKING:
    import pandas as pd

    from bussim.exact.sizing.choice import Choice
    from bussim.exact.sizing.ports.setting import PortSetting


@dataclass(frozen=True, slots=True, repr=False)
class Sized:
    """What ``bussim size`` recommends; :meth:`to_dict` is its JSON form.

    ``links`` are by bus, ``ports`` by master (``press1.COM3``, or a device); times are ticks there
    (1/72 MHz) and ms in :meth:`to_dict`.
    """

    scenario: Scenario
    links: dict[str, Sizing]
    ports: dict[str, PortSizing]

    def __repr__(self) -> str:
        settings: dict[str, Choice | PortSetting | None] = {
            name: each.recommended for part in (self.links, self.ports) for name, each in part.items()
        }
        said = [
            f"{name}: " + (f"{best.retries} retries, timeout {ms(best.timeout)} ms" if best else "no setting")
            for name, best in settings.items()
        ]
        return f"<Sized of {self.scenario.name!r}: {'; '.join(said)}>"

    def to_dict(self) -> dict[str, object]:
        """The JSON form, times in ms."""
        links = {bus: sizing.to_json() for bus, sizing in self.links.items()}
        result: dict[str, object] = {"schema": 1, "links": links}
        if self.ports:
            result["ports"] = {node: sizing.to_json() for node, sizing in self.ports.items()}
        if self.scenario.carried:
            result["warnings"] = [asdict(each) for each in self.scenario.carried]
        return result

    def table(self, name: str) -> pd.DataFrame:
        """The settings of a link that no other beats, or the settings of a poll list: one row each, in ms.

        Raises KeyError for a name that is neither a link's bus nor a master.
        """
        import pandas as pd

        if name in self.ports:
            return pd.json_normalize([each.to_json() for each in self.ports[name].table])
        return pd.json_normalize([choice.to_json() for choice in self.links[name].front])


def size(
    scenario: Scenario | str | PathLike[str],
    goals: Iterable[str] = (),
    responses: Mapping[str, float] | None = None,
) -> Sized:
    """Choose retries and timeout of each link, and timeout, retries and interval of each Modbus poll list.

    ``scenario`` is given as such, as a file or by a built-in name; its faults are left out. ``goals`` are
    texts such as ``"errors<=1/y"`` and ``"dead<=400ms"``. ``responses`` are the longest response times that
    were measured, in ms by master (``press1.COM3``, or a device): no timeout is shorter. The D8179 and
    D8180 that the links have do not matter: what is recommended to one holds for all of them.

    Raises ScenarioError or UsageError for a scenario that cannot be loaded or has nothing to size;
    UsageError for what is no goal, or one of what the scenario lacks, and for responses of
    none of its masters.
    """
    loaded = scenario if isinstance(scenario, Scenario) else loader.load(scenario)
    try:
        wanted = Goals().with_texts(goals)
    except ValueError as error:
        raise UsageError(str(error)) from None
    models = from_scenario(loaded, ignore_faults=True, bound_end=True)
    seen = {node: round(longest * TICKS_PER_MS) for node, longest in (responses or {}).items()}
    ports = size_ports(loaded, wanted, seen)
    if seen and not seen.keys() & ports.keys():
        hint = suggest(next(iter(seen)), list(ports)) if ports else "it has none"
        raise UsageError(f"responses of {names(seen)}: no Modbus master of {loaded.name}; {hint}")
    if not (models or ports):
        raise UsageError(f"{loaded.name} has neither an N:N link nor a Modbus poll list")
    known = {*(LINK_GOALS if models else ()), *(PORT_GOALS if ports else ())}
    strange = [goal for goal in wanted.given if goal not in known]
    if strange:
        missing = "Modbus poll lists" if models else "N:N links"
        texts = (f"--goal {goal} is of {missing}, of which {loaded.name} has none" for goal in strange)
        raise UsageError("\n".join(texts))
    return Sized(loaded, {bus: size_link(model, wanted) for bus, model in models.items()}, ports)
