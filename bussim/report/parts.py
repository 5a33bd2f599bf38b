"""The numbered charts of a report's page."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from bussim.report.charts import Quantity, histogram_chart
from bussim.report.tables import Table
from bussim.results.meters.histogram import Histogram
from bussim.words.language import say


@dataclass(frozen=True, slots=True)
class Chart:
    """A chart of the page: its heading, its text for screen readers, and its data as a table."""

    number: int
    title: str
    description: str
    data: Table | None = None
    caption: str = ""


@dataclass(slots=True)
class Charts:
    """Numbers the charts of a page and keeps what its script needs."""

    payload: list[dict[str, Any]] = field(default_factory=list)

    def add(self, content: dict[str, Any], description: str, data: Table | None, caption: str = "") -> Chart:
        """Take a chart of :mod:`bussim.report.charts` in."""
        self.payload.append({**content, "description": description})
        return Chart(len(self.payload) - 1, content["title"], description, data, caption)

    def overlay(self, histograms: Mapping[str, Histogram], title: str, of: str, quantity: Quantity) -> Chart:
        """Take the histograms of several runs in, on one axis; ``of`` is what is drawn."""
        return self.add(
            histogram_chart(histograms, None, say("chart_overlay", title=title), quantity),
            say("chart_overlay_said", of=of, runs=", ".join(histograms)),
            None,
            say("chart_overlay_caption", counted=quantity.counted),
        )
