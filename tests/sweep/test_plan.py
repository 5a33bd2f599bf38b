from __future__ import annotations

from pathlib import Path

import pytest

from bussim import api
from bussim.errors import ScenarioError, UsageError
from bussim.sweep.figures import figures_of
from bussim.sweep.identity import differences, read_manifest
from bussim.sweep.jobs import Job, masters_of, run_job
from bussim.sweep.plan import Plan
from tests.sweep.samples import BER, RETRIES, TIMEOUT, noisy


@pytest.fixture
def scenario(tmp_path: Path) -> Path:
    return noisy(tmp_path)


def bad_points(scenario: Path, *vary: str, sets: tuple[str, ...] = ()) -> list[str]:
    with pytest.raises(ScenarioError) as caught:
        Plan(scenario, vary, sets=sets).check()
    return [str(problem) for problem in caught.value.problems]


def test_a_run_is_what_bussim_run_gives_with_its_values_and_its_seed(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=1,3", f"{BER}=2e-3,1e-4"], sets=["duration=2 s"], repeat=2)
    assert plan.runs == 8
    assert plan.in_words(5) == f"{RETRIES}=3, {BER}=2e-3, repeat 2"
    outcome = run_job(plan.job(5))
    alone = api.load(scenario, [f"{RETRIES}=3", f"{BER}=2e-3", "duration=2s", f"seed={plan.seed(5)}"])
    assert outcome == (5, figures_of(api.run(alone, rows=False).summary, masters_of(alone)), "")
    assert outcome.figures is not None
    assert outcome.figures["link.failed_attempts"]
    assert outcome.figures != run_job(plan.job(4)).figures


def test_a_varied_seed_is_the_runs_own(scenario: Path) -> None:
    plan = Plan(scenario, ["seed=11:13:1"])
    assert [plan.seed(run) for run in range(3)] == [None] * 3
    alone = api.load(scenario, ["seed=12"])
    assert run_job(plan.job(1)).figures == figures_of(api.run(alone, rows=False).summary, masters_of(alone))
    with pytest.raises(UsageError, match="--vary seed and --repeat exclude each other"):
        Plan(scenario, ["seed=1,2"], repeat=2)


def test_common_random_numbers_damages_the_same_bits(scenario: Path) -> None:
    """With retries that are never used up, the noise that a link meets does not depend on their number."""
    vary = [f"{RETRIES}=9,10"]
    one, other = (
        run_job(Plan(scenario, vary, common_random_numbers=True).job(run)).figures for run in (0, 1)
    )
    assert one == other
    one, other = (run_job(Plan(scenario, vary).job(run)).figures for run in (0, 1))
    assert one != other


def test_bad_points_are_all_named(scenario: Path) -> None:
    assert bad_points(scenario, f"{RETRIES}=9:12:1") == [
        f"--vary {RETRIES}={value}: {RETRIES} is {value}, allowed 0..10" for value in (11, 12)
    ]
    found = bad_points(scenario, f"{RETRIES}=9:12:1", f"{TIMEOUT}=20ms:60ms:20ms", f"{BER}=1,2")
    assert [line.split(": ")[0] for line in found] == [
        f"--vary {key}"
        for key in (
            f"{BER}=2",
            f"{RETRIES}=11",
            f"{RETRIES}=12",
            f"{TIMEOUT}=20 ms",
            f"{TIMEOUT}=40 ms",
        )
    ]


def test_a_mistake_that_only_some_points_have_names_them(scenario: Path) -> None:
    """A jitter is wrong only together with a mean that is not above it."""
    found = bad_points(scenario, "plcs.press.scan.mean=2ms,4ms,8ms", "plcs.press.scan.jitter=1ms,4ms")
    assert len(found) == 1
    assert "must be less than the mean" in found[0]
    assert (
        "(at plcs.press.scan.mean=2ms, plcs.press.scan.jitter=4ms"
        " / plcs.press.scan.mean=4ms, plcs.press.scan.jitter=4ms)" in found[0]
    )
    many = bad_points(scenario, "plcs.press.scan.mean=1ms:100ms:1ms", "plcs.press.scan.jitter=1us,90ms")
    assert "and 70 more points)" in many[0]
    everywhere = bad_points(scenario, "buses.link.nn=false", f"{BER}=0:1:0.1")
    assert everywhere
    for line in everywhere:
        assert "noisy.yaml:10:" in line or "noisy.yaml:11:" in line
        assert line.endswith("(at every point)")


@pytest.mark.slow
def test_thousands_of_mistakes_do_not_fill_the_screen(scenario: Path) -> None:
    found = bad_points(scenario, f"{RETRIES}=11:400:1")
    assert len(found) == 101
    assert found[-1].endswith("and 290 more mistakes")


def test_keys_that_lead_nowhere_are_all_named(scenario: Path) -> None:
    with pytest.raises(UsageError) as caught:
        Plan(
            scenario,
            ["plcs.pres.nn.retries=0:2:1", "plcs.press.nn.retrys=0:2:1", f"{RETRIES}=1", "noise.7.ber=0"],
        )
    assert str(caught.value).split("\n") == [
        "--vary plcs.pres.nn.retries=0:2:1: plcs has no pres; did you mean press?",
        (
            "--vary plcs.press.nn.retrys=0:2:1: plcs.press.nn.retrys is not a key here; "
            "allowed are bus, port, station, slaves, mode, retries, timeout; did you mean retries?"
        ),
        "--vary noise.7.ber=0: noise has no entry 7; allowed 0..0",
    ]


def test_two_names_of_one_key_are_noticed(scenario: Path) -> None:
    plan = Plan(scenario, [f"{RETRIES}=1,2", "plcs.0.nn.retries=3,4"])
    with pytest.raises(
        UsageError, match=r"--vary plcs.press.nn.retries=1: another option sets the same value"
    ):
        plan.check()
    with pytest.raises(UsageError, match="another option sets the same value"):
        Plan(scenario, ["plcs.0.nn.retries=3,4"], sets=[f"{RETRIES}=1"])
    with pytest.raises(UsageError, match="is varied and set"):
        Plan(scenario, [f"{RETRIES}=3,4"], sets=[f"{RETRIES}=1"])


def test_mistakes_of_the_scenario_itself(tmp_path: Path, scenario: Path) -> None:
    with pytest.raises(ScenarioError, match="no such file"):
        Plan(tmp_path / "none.yaml", [f"{RETRIES}=1,2"])
    scenario.write_text(scenario.read_text().replace("retries: 3", "retries: 33"))
    with pytest.raises(ScenarioError, match=r"noisy.yaml:10:\d+: nn.retries is 33"):
        Plan(scenario, [f"{RETRIES}=1,2"])


def test_what_distinguishes_two_sweeps(scenario: Path, tmp_path: Path) -> None:
    vary = [f"{RETRIES}=0:5:1", f"{BER}=1e-4,1e-3"]
    here = Plan(scenario, vary, sets=["duration=2s"], repeat=3).manifest()
    assert differences(here, Plan(scenario, vary, sets=["duration=2s"], repeat=3).manifest()) == []
    other = Plan(
        scenario, vary[:1], sets=[f"{TIMEOUT}=60ms"], repeat=4, common_random_numbers=True
    ).manifest()
    assert differences(here, other | {"bussim": "0.0.9"}) == [
        f'the version of bussim is "{here["bussim"]}" here, "0.0.9" there',
        "--repeat is 3 here, 4 there",
        "--same-luck is false here, true there",
        f"{BER} is varied here, not there",
        'duration is "2 s" here, "400 ms" there',
        "and 1 more",
    ]
    longer = Plan(scenario, [f"{RETRIES}=0:4:2", *vary[1:]], sets=["duration=2s"], repeat=3).manifest()
    assert differences(here, longer) == [f"{RETRIES} is varied over 0,1,…,5 (6) here, 0,2,4 there"]
    turned = Plan(scenario, vary[::-1], sets=["duration=2s"], repeat=3).manifest()
    assert differences(here, turned) == ["the order of --vary is another one there"]
    for vary_there in (3, [{**here["vary"][0], "values": 5}], [{**here["vary"][0], "values": [5]}]):
        assert differences(here, {"vary": vary_there})  # a file that is no manifest
    (tmp_path / "sweep.json").write_text("[" * 100_000)
    assert read_manifest(tmp_path) is None
    scenario.write_text("# only a comment\n" + scenario.read_text())
    again = Plan(scenario, vary, sets=["duration=2s"], repeat=3).manifest()
    assert differences(here, again) == []
    scenario.write_text(scenario.read_text().replace("scan: 6 ms", "scan: 7 ms"))
    again = Plan(scenario, vary, sets=["duration=2s"], repeat=3).manifest()
    assert differences(again, here) == ['plcs.1.scan.mean is "7 ms" here, "6 ms" there']


def test_values_that_are_read_alike_are_the_same_sweep(scenario: Path) -> None:
    here = Plan(scenario, [f"{TIMEOUT}=50ms,60ms"], sets=["duration=2s"]).manifest()
    for timeouts, duration in (
        ("50 ms,60 ms", "2 s"),
        ("50.0ms, 6e1 ms", "2000ms"),
        ("50000us,60000us", "2 s"),
    ):
        there = Plan(scenario, [f"{TIMEOUT}={timeouts}"], sets=[f"duration={duration}"]).manifest()
        shown = (
            [f"the column of {TIMEOUT} is {TIMEOUT}_ms here, {TIMEOUT}_us there"] if "us" in timeouts else []
        )
        assert differences(here, there) == shown
    text = scenario.read_text()
    for one, other in (("scan: 6 ms", "scan: {mean: 0.006 s}"), ("seed: 3", "seed: 0x3")):
        assert one in text
        scenario.write_text(text.replace(one, other))
        there = Plan(scenario, [f"{TIMEOUT}=50ms,60ms"], sets=["duration=2s"]).manifest()
        assert differences(here, there) == []
    numbers = [Plan(scenario, [f"{BER}={ber},0.01"]).manifest() for ber in ("1e-3", "0.001", "1.0e-3")]
    assert differences(numbers[0], numbers[1]) == differences(numbers[0], numbers[2]) == []


def test_a_worker_of_another_version_refuses(scenario: Path) -> None:
    job = Plan(scenario, [f"{RETRIES}=1,2"]).job(0)
    old = Job(job.run, job.text, job.name, job.overrides, job.seed, version="0.0.1")
    outcome = run_job(old)
    assert outcome.figures is None
    assert "the sweep is made by 0.0.1" in outcome.error


def test_an_exception_in_a_run_is_its_outcome(scenario: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object, **__: object) -> None:
        raise ZeroDivisionError("a bug")

    monkeypatch.setattr(api, "run", fail)
    outcome = run_job(Plan(scenario, [f"{RETRIES}=1,2"]).job(1))
    assert outcome == (1, None, "ZeroDivisionError: a bug")
