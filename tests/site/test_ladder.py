"""The ladder of the guide, in the built-in scenario: it counts exactly what the link scans were."""

import bussim
from bussim.scenario import builtin
from bussim.site.forms import Settings
from bussim.site.link import SiteLink
from bussim.site.readout import SiteProfile
from tests.guide.pages import blocks, page


def test_the_ladder_counts_the_link_scans() -> None:
    result = bussim.run(bussim.load("registers_on_site", ["duration=60 s"]))
    shown = (result.link_scans["duration_ms"] + 0.5).astype(int).to_numpy()
    counted = result.values.groupby("device")["value"].last()
    for device, least in zip(("D500", "D501", "D502"), (70, 101, 125), strict=True):
        rises = int(((shown[1:] >= least) & (shown[:-1] < least)).sum() + (shown[0] >= least))
        assert counted.get(device, 0) == rises, device
    assert counted["D503"] == shown.max()


def test_the_guide_has_the_ladder_of_the_scenario() -> None:
    def instructions(text: str) -> list[list[str]]:
        return [
            words
            for line in text.splitlines()
            if (words := line.partition(";")[0].split()) and words != ["END"]
        ]

    program = builtin.read("registers_on_site").split("program: |\n")[1].split("  - {name: feeder")[0]
    assert instructions(blocks(page("site"), "il")[0]) == instructions(program)


def test_its_thresholds_are_those_of_the_plan() -> None:
    settings = Settings.model_construct(slaves=3, mode=2, retries=3, timeout=50 * 72_000)
    link = SiteLink(SiteProfile({"base": "pw10"}), settings, ("press", "feeder", "lift", "saw"))
    assert [int(each) + 1 for each in link.thresholds()] == [70, 101, 125]
