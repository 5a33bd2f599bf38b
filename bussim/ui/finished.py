"""What the page shows of a simulation that is over."""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

from bussim.api import open_run
from bussim.exact.metrics import fine_curve
from bussim.exact.solution import between_faults
from bussim.report.charts import histogram_chart, scene_chart
from bussim.report.runs import ExactDistribution
from bussim.report.scene import MOST_SHAPES, worst_scenes
from bussim.results.verdict.catalogue import sentence
from bussim.scenario.model import Scenario
from bussim.trace.file import TRACE, read_trace
from bussim.words.language import shown, use_language


def finished(folder: Path, scenario: Scenario, lang: str) -> dict[str, Any]:
    """Summary, verdict, histogram over the law and the longest link scan of a run's folder, by bus.

    Sentences are in the language ``lang``.
    """
    result = open_run(folder)
    record = result.record
    laws = _laws(scenario)
    histograms = {
        bus: histogram_chart({bus: link.scan_times.histogram}, laws.get(bus), bus)
        for bus, link in record.links.items()
        if link.scan_times.histogram.count
    }
    worst = {}
    if (folder / TRACE).is_file():
        scenes = worst_scenes(read_trace(folder), record, record.links, MOST_SHAPES)
        worst = {bus: {**scene_chart(scene, bus), "why": list(scene.why)} for bus, scene in scenes.items()}
    said = [sentence(each) for each in record.summary["verdict"]]
    found = {
        "links": record.summary["links"],
        "verdict": said,
        "warnings": record.summary["warnings"],
        "histograms": histograms,
        "worst": worst,
        "means": {bus: law.figures["mean_ms"] for bus, law in laws.items()},
    }
    with use_language(lang):
        return cast("dict[str, Any]", shown(found))


def _laws(scenario: Scenario) -> dict[str, ExactDistribution]:
    """The distribution of each link of a run; of one that faults disturb that of the time between them."""
    laws = {}
    for bus, law in between_faults(scenario).items():
        if law.distribution is not None:
            x, tail = fine_curve(law.distribution)
            laws[bus] = ExactDistribution(law.to_json(), "", law.model.notes, x.tolist(), tail.tolist())
    return laws
