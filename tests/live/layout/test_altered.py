"""Lines of other layouts: what silences tell of them, the layouts that are proposed, and what is refused."""

import json
import random
from pathlib import Path
from typing import Any

import pytest

import bussim
from bussim.cli import main
from bussim.line.characters import NN_LINE
from bussim.live.arrival import placed
from bussim.live.layout import file
from bussim.live.layout.silences import Polling, bursts, polling
from bussim.live.layout.sums import KINDS
from bussim.live.recordings.source import Chunk
from bussim.units import TICKS_PER_SECOND
from tests.live.layout.generator import ALTERED, Made, Truth, assumed, counted_to, recorded
from tests.live.recordings.generator import Sent, Serial, nn_link, pcap, sigrok, wave
from tests.live.recordings.reading import sniffed
from tests.selection import quick

#: Links of other sizes, with dead stations, bit errors and lost replies.
LINKS: dict[str, dict[str, Any]] = {
    "three slaves": {"slaves": 3, "size": 40},
    "seven slaves": {"slaves": 7, "size": 8},
    "one dead": {"slaves": 3, "dead": (2,), "seconds": 15},
    "the last dead": {"slaves": 2, "dead": (2,), "seconds": 15},
    "bit errors": {"slaves": 3, "ber": 1e-4, "seconds": 15, "size": 40},
    "few retries": {"slaves": 2, "loss": 0.01, "seconds": 15},
    "dead and bit errors": {"slaves": 3, "dead": (1,), "ber": 1e-4, "seconds": 30},
    "long frames and bit errors": {"slaves": 1, "size": 72, "ber": 1e-4, "seconds": 15},
}
#: By the assumed layout the frames of this one are sound: only what their data mean differs.
SOUND = "low byte of words first"


class Line:
    """A recording on disk, and what the commands say of it."""

    def __init__(self, folder: Path, truth: Truth, capsys: pytest.CaptureFixture[str]) -> None:
        self.truth, self._capsys = truth, capsys
        self.path, self.layout = folder / "line.txt", folder / "layout.yaml"
        self.path.write_text(truth.text, encoding="utf-8")

    def run(self, command: str, *options: str) -> tuple[int, str, str]:
        """Exit code and both outputs."""
        code = main([command, str(self.path), *options])
        return code, *self._capsys.readouterr()

    def sniff(self, *options: str) -> dict[str, Any]:
        """What sniff says."""
        code, output, _ = self.run("sniff", "--json", *options)
        assert code == 0
        found: dict[str, Any] = json.loads(output)
        return found


def check(line: Line, *, slaves: int, dead: tuple[int, ...] = ()) -> None:
    """What does not depend on the layout is right, the layout is refused, and the proposed one is right."""
    truth = line.truth
    found = line.sniff("--propose", str(line.layout))
    link = found["link"]
    assert link["scan_time_ms"]["mean"] == pytest.approx(truth.mean_scan, abs=0.1)
    assert link["scans"] == len(truth.scans)
    assert link["slaves"] == slaves
    assert link["silent_stations"] == list(dead)
    exchanges = {int(name.split()[1]): each for name, each in found["exchanges"].items()}
    assert {station: each["attempts"] for station, each in exchanges.items()} == truth.decided
    for outcome, expected in (("no_answer", truth.lost), ("damaged", truth.damaged)):
        counts = {station: each["outcomes"].get(outcome, 0) for station, each in exchanges.items()}
        assert {station: count for station, count in counts.items() if count} == expected
    assert found["layout"]["fits"] is False
    assert found["damaged"] is None
    assert "layout" in {warning["code"] for warning in found["warnings"]}
    if truth.lost:
        assert link["timeout_ms"] == 100

    code, output, error = line.run("fit")
    assert (code, output) == (1, "")
    assert "does not fit" in error
    assert "--propose" in error

    by_layout = line.sniff("--layout", str(line.layout))
    assert by_layout["layout"] is None
    assert by_layout["frames"] == truth.frames
    # A bit error is as good as never undetected here: all sums have eight bits or more, most errors are single.
    assert by_layout["damaged"] == pytest.approx(truth.visible, abs=1 + 0.03 * truth.visible)
    assert by_layout["link"]["slaves"] == slaves


@pytest.mark.parametrize("name", quick(4, [name for name in ALTERED if name != SOUND]))
def test_a_line_of_another_layout_is_understood(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    check(Line(tmp_path, recorded(ALTERED[name], seconds=2.5), capsys), slaves=1)


@pytest.mark.slow
@pytest.mark.parametrize("link", quick(1, LINKS))
@pytest.mark.parametrize("name", [name for name in ALTERED if name != SOUND])
def test_dead_stations_bit_errors_and_retries_are_told_in_every_layout(
    name: str, link: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    given = LINKS[link]
    line = Line(tmp_path, recorded(ALTERED[name], **given), capsys)
    check(line, slaves=given["slaves"], dead=given.get("dead", ()))


@pytest.mark.parametrize("made", [assumed(), ALTERED[SOUND]])
@pytest.mark.parametrize("ber", [0.0, 1e-4])
def test_a_layout_that_fits_is_not_refused(
    made: Made, ber: float, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    line = Line(tmp_path, recorded(made, slaves=2, size=40, seconds=6, ber=ber), capsys)
    found = line.sniff("--propose", str(line.layout))
    assert found["layout"] is None
    assert found["damaged"] == line.truth.visible
    assert not line.layout.exists()
    assert line.run("fit", "--simulate", "0 s", "--json")[0] == 0


def polled(truth: Truth, chars: Any) -> Polling:
    """A line's polling, with other characters in place of its own."""
    placed_rows = []
    for at, data in truth.rows:
        start = round(at * TICKS_PER_SECOND) - NN_LINE.characters(len(data))
        placed_rows.append(Chunk(placed(chars(data), start, NN_LINE)))
    found = polling(list(bursts(placed_rows, NN_LINE.characters(1))), NN_LINE.characters(1))
    assert found is not None
    return found


@pytest.mark.parametrize("link", LINKS)
@pytest.mark.parametrize("what", ["zeros", "random characters"])
def test_nothing_depends_on_what_the_characters_are(link: str, what: str) -> None:
    truth = recorded(assumed(), **LINKS[link])
    rng = random.Random(7)
    found = polled(truth, lambda data: bytes(len(data)) if what == "zeros" else rng.randbytes(len(data)))
    durations = [scan.duration for scan in found.scans if scan.duration is not None]
    assert found.stations == LINKS[link]["slaves"]
    assert 1000 * sum(durations) / len(durations) / TICKS_PER_SECOND == pytest.approx(
        truth.mean_scan, abs=0.1
    )
    attempts = [each for scan in found.scans for each in scan.attempts]
    # Without the characters a lost poll beside a dead station may be either's.
    for station, count in truth.decided.items():
        assert sum(each.station == station for each in attempts) == pytest.approx(count, abs=2)
    assert sum(each.reply is None for each in attempts) == sum(truth.lost.values())
    assert sum(each.failed and each.reply is not None for each in attempts) == sum(truth.damaged.values())


@pytest.mark.parametrize(
    "chars",
    [
        pytest.param(lambda rng: rng.randbytes(rng.randrange(1, 40)), id="random lengths"),
        pytest.param(lambda rng: rng.choice([b"tick", b"a longer line of a log"]), id="two lengths"),
    ],
)
def test_what_nobody_polls_is_no_link(chars: Any, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    rng = random.Random(3)
    truth, now = Truth(), 0.1
    for _ in range(300):
        now += rng.expovariate(20) + 0.02
        truth.rows.append((now, chars(rng)))
    found = Line(tmp_path, truth, capsys).sniff()
    assert "link" not in found
    assert found["layout"] is None
    assert [each["code"] for each in found["warnings"]] == ["not_recognised"]


def test_what_no_usual_layout_fits_is_told_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = recorded(assumed(), slaves=2)
    rng = random.Random(11)
    truth.rows = [(at, rng.randbytes(len(chars))) for at, chars in truth.rows]
    line = Line(tmp_path, truth, capsys)
    code, output, error = line.run("sniff", "--propose", str(line.layout))
    assert code == 1
    assert "link scan time" in output
    assert "none of the usual layouts fits" in error
    assert list(tmp_path.iterdir()) == [line.path]


@pytest.mark.parametrize(
    "serial", [Serial(38400, 8, "N"), pytest.param(Serial(38400, 7, "E"), marks=pytest.mark.slow)]
)
@pytest.mark.parametrize("inverted", quick(1, [True, False]))
def test_a_session_of_another_layout_is_read_at_its_own_rate_and_format(
    serial: Serial, inverted: bool, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    truth = recorded(ALTERED["other headers, ends with CR LF"], slaves=2, size=8, seconds=1.5)
    sent = [Sent(at - serial.lasts(len(chars)), chars) for at, chars in truth.rows]
    levels = wave(sent, serial, 1_000_000)
    path = sigrok(tmp_path / "line.sr", 1_000_000, {"D0": 1 - levels if inverted else levels})
    assert main(["sniff", str(path), "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert (found["baud"], found["format"], found["inverted"]) == (38400, serial.name, inverted)
    assert found["link"]["slaves"] == 2
    assert found["link"]["scan_time_ms"]["mean"] == pytest.approx(truth.mean_scan, abs=0.1)
    assert found["layout"]["sound"] == truth.frames


@pytest.mark.parametrize("options", [(), ("--channel", "TX,RX")], ids=["found", "said"])
@pytest.mark.parametrize("name", quick(1, ["sum without end character", "other headers, ends with CR LF"]))
def test_another_layout_on_two_channels_is_one_line(
    name: str, options: tuple[str, ...], tmp_path: Path
) -> None:
    """Of the first one the polls alone are sound by the assumed layout."""
    made, serial = ALTERED[name], Serial(38400, 7, "E", 1)
    truth = recorded(made, slaves=2, size=8, seconds=1)
    polls = {made.poll(station, scan) for station in (1, 2) for scan in range(256)}
    of_master, before = [], b""
    for _, chars in truth.rows:
        of_master.append(chars in polls or before not in polls)
        before = chars
    sent = [Sent(at - serial.lasts(len(chars)), chars) for at, chars in truth.rows]
    wires = [[each for each, own in zip(sent, of_master, strict=True) if own is one] for one in (True, False)]
    levels = {name: wave(wire, serial, 400_000) for name, wire in zip(("TX", "RX"), wires, strict=True)}
    found = sniffed(sigrok(tmp_path / "line.sr", 400_000, levels), *options)
    assert found["channels"] == ["TX", "RX"]
    assert found["link"]["slaves"] == 2
    assert found["link"]["scan_time_ms"]["mean"] == pytest.approx(truth.mean_scan, abs=0.1)
    assert (found["layout"]["fits"], found["layout"]["sound"]) == (False, truth.frames)


def test_a_line_whose_replies_alone_are_damaged_has_the_layout_of_its_master(tmp_path: Path) -> None:
    sent = [
        each._replace(chars=each.chars[:5] + b"\x00" + each.chars[6:]) if each.wire else each
        for each in nn_link(Serial(38400, 7, "E", 1), 60)
    ]
    found = sniffed(pcap(tmp_path / "line.pcap", sent, 148), "-b", "38400")
    assert (found["layout"], found["frames"], found["damaged"]) == (None, 300, 120)


def test_the_guide_prints_the_layout_that_ships() -> None:
    shipped = (Path(file.__file__).parent / "assumed.yaml").read_text(encoding="utf-8")
    guide = (Path(bussim.__file__).parent / "guide" / "wires.md").read_text(encoding="utf-8")
    assert shipped.split("\n", 3)[3] in guide
    assert [kind for kind in KINDS if f"`{kind}`" not in guide] == []


@pytest.mark.parametrize("counts", [3, 10, 16])
def test_scans_are_measured_wherever_the_counter_begins_again(
    counts: int, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The counter has one digit; how far it counts is seen, and where a frame is missing that is told."""
    truth = recorded(counted_to(counts), slaves=3, loss=0.03, seconds=10)
    found = Line(tmp_path, truth, capsys).sniff()
    assert found["layout"] is None
    # Until a first short scan ends with 0 it cannot be known.
    assert found["link"]["scans"] >= len(truth.scans) - 2
    assert found["scans_unmeasured"] <= 2 * (17 - counts) * (counts < 16)
    own = [index for index, (_, chars) in enumerate(truth.rows) if chars[:2] == b"\x020"]
    del truth.rows[own[len(own) // 2]]
    short = Line(tmp_path, truth, capsys).sniff()
    assert short["link"]["scans"] == found["link"]["scans"] - 2
    assert short["scans_unmeasured"] == found["scans_unmeasured"] + 2
