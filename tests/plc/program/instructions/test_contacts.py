"""Contacts, blocks and branches, from their definitions in words."""

from __future__ import annotations

import itertools

import pytest

from tests.plc.program.rigs import Rig, always


def table(text: str, *inputs: str) -> list[int]:
    """Y0 for every state of the inputs, the first one changing slowest."""
    return [
        Rig(text).scan(**dict(zip(inputs, states, strict=True))).bit("Y0")
        for states in itertools.product((0, 1), repeat=len(inputs))
    ]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("LD X0 / OUT Y0", lambda a: a),
        ("LDI X0 / OUT Y0", lambda a: not a),
        ("LD X0 / INV / OUT Y0", lambda a: not a),
        ("LD X0 / INV / INV / OUT Y0", lambda a: a),
        ("LD X0 / NOP / OUT Y0", lambda a: a),
    ],
)
def test_one_contact(text: str, says) -> None:
    assert table(text, "X0") == [int(says(a)) for a in (0, 1)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("LD X0 / AND X1 / OUT Y0", lambda a, b: a and b),
        ("LD X0 / ANI X1 / OUT Y0", lambda a, b: a and not b),
        ("LD X0 / OR X1 / OUT Y0", lambda a, b: a or b),
        ("LD X0 / ORI X1 / OUT Y0", lambda a, b: a or not b),
        ("LDI X0 / OR X1 / INV / OUT Y0", lambda a, b: a and not b),
        ("LD X0 / LD X1 / ANB / OUT Y0", lambda a, b: a and b),
        ("LD X0 / LD X1 / ORB / OUT Y0", lambda a, b: a or b),
        ("LD X0 / AND X1 / INV / OUT Y0", lambda a, b: not (a and b)),
    ],
)
def test_two_contacts(text: str, says) -> None:
    assert table(text, "X0", "X1") == [int(says(a, b)) for a, b in itertools.product((0, 1), repeat=2)]


@pytest.mark.parametrize(
    ("text", "says"),
    [
        # AND takes all that stands before it, OR lies parallel to the whole block.
        ("LD X0 / OR X1 / AND X2 / ORI X3 / OUT Y0", lambda a, b, c, d: ((a or b) and c) or not d),
        ("LD X0 / AND X1 / OR X2 / AND X3 / OUT Y0", lambda a, b, c, d: ((a and b) or c) and d),
        ("LD X0 / AND X1 / LD X2 / AND X3 / ORB / OUT Y0", lambda a, b, c, d: (a and b) or (c and d)),
        ("LD X0 / OR X1 / LD X2 / OR X3 / ANB / OUT Y0", lambda a, b, c, d: (a or b) and (c or d)),
        (
            "LD X0 / LD X1 / LD X2 / LD X3 / ORB / ANB / ORB / OUT Y0",
            lambda a, b, c, d: a or (b and (c or d)),
        ),
        ("LD X0 / LD X1 / ORB / LD X2 / ORB / AND X3 / OUT Y0", lambda a, b, c, d: (a or b or c) and d),
        ("LD X0 / AND X1 / AND X2 / AND X3 / OUT Y0", lambda a, b, c, d: a and b and c and d),
        ("LD X0 / OR X1 / ORI X2 / OR X3 / OUT Y0", lambda a, b, c, d: a or b or not c or d),
        ("LD X0 / OR X1 / ANI X2 / AND X3 / OUT Y0", lambda a, b, c, d: (a or b) and not c and d),
        ("LD X0 / OR X1 / OR X2 / ANI X3 / OUT Y0", lambda a, b, c, d: (a or b or c) and not d),
        ("LD X0 / AND X1 / OR X2 / OR X3 / OUT Y0", lambda a, b, c, d: (a and b) or c or d),
        ("LD X0 / AND X1 / AND X2 / OR X3 / OUT Y0", lambda a, b, c, d: (a and b and c) or d),
        (
            "LD X0 / LDI X1 / LD X2 / ORB / ANB / INV / AND X3 / OUT Y0",
            lambda a, b, c, d: not (a and (not b or c)) and d,
        ),
        (
            "LD X0 / OR X1 / LD X2 / ANB / LD X3 / ORB / INV / OUT Y0",
            lambda a, b, c, d: not (((a or b) and c) or d),
        ),
    ],
)
@pytest.mark.parametrize("use", ["", "SET", "P"])
def test_four_contacts(text: str, says, use: str) -> None:
    text = text.replace("OUT Y0", {"": "OUT Y0", "SET": "SET Y0", "P": "MOVP K1 K1Y0"}[use])
    expected = [int(bool(says(*s))) for s in itertools.product((0, 1), repeat=4)]
    assert table(text, "X0", "X1", "X2", "X3") == expected


def test_a_series_of_forty_contacts_needs_them_all() -> None:
    text = "LD M0 / " + " / ".join(f"AND M{n}" for n in range(1, 40)) + " / OUT Y0"
    everyone = {f"M{n}": 1 for n in range(40)}
    assert Rig(text).scan(**everyone).bit("Y0") == 1
    for absent in range(40):
        assert Rig(text).scan(**(everyone | {f"M{absent}": 0})).bit("Y0") == 0


def test_a_branch_returns_to_where_mps_stood() -> None:
    text = "LD X0 / MPS / AND X1 / OUT Y0 / MRD / ANI X1 / OUT Y1 / MPP / OUT Y2"
    assert Rig(text).scan(X0=1, X1=1).bits("Y0", "Y1", "Y2") == [1, 0, 1]
    assert Rig(text).scan(X0=1, X1=0).bits("Y0", "Y1", "Y2") == [0, 1, 1]
    assert Rig(text).scan(X0=0, X1=1).bits("Y0", "Y1", "Y2") == [0, 0, 0]


def test_branches_within_branches() -> None:
    text = (
        "LD X0 / MPS / AND X1 / MPS / AND X2 / OUT Y0 / MPP / OUT Y1 / MPP / MPS / LD X3 / ORI X1 / ANB / OUT Y2 / "
        "MPP / OUT Y3"
    )
    for a, b, c, d in itertools.product((0, 1), repeat=4):
        rig = Rig(text).scan(X0=a, X1=b, X2=c, X3=d)
        assert rig.bits("Y0", "Y1", "Y2", "Y3") == [a & b & c, a & b, a & (d | (1 - b)), a]


def test_a_branch_keeps_the_value_and_not_the_contact() -> None:
    # M0 goes off in the first branch; the second one still has what MPS found.
    assert Rig("LD M0 / MPS / RST M0 / MPP / OUT Y0").scan(M0=1).bits("M0", "Y0") == [0, 1]
    assert Rig("LDI M0 / OUT M0 / OUT Y0 / AND X0 / OUT Y1").scan(X0=1).bits("M0", "Y0", "Y1") == [1, 1, 1]


def test_contacts_may_follow_an_output() -> None:
    text = "LD X0 / OUT Y0 / AND X1 / OUT Y1 / LD X2 / OR X3 / ANB / OUT Y2"
    for a, b, c, d in itertools.product((0, 1), repeat=4):
        rig = Rig(text).scan(X0=a, X1=b, X2=c, X3=d)
        assert rig.bits("Y0", "Y1", "Y2") == [a, a & b, a & b & (c | d)]


def test_a_contact_sees_what_a_rung_above_has_done() -> None:
    assert Rig("LD X0 / OUT M0 / LD M0 / OUT Y0").scan(X0=1).bit("Y0") == 1
    late = Rig("LD M0 / OUT Y0 / LD X0 / OUT M0").scan(X0=1)
    assert late.bit("Y0") == 0
    assert late.scan().bit("Y0") == 1


@pytest.mark.parametrize(("name", "rises", "falls"), [("LDP", 1, 0), ("LDF", 0, 1)])
def test_an_edge_lasts_one_scan(name: str, rises: int, falls: int) -> None:
    rig = Rig(f"{name} X0 / OUT Y0").scan()
    seen = [rig.scan(X0=state).bit("Y0") for state in (0, 1, 1, 0, 0, 1, 0)]
    assert seen == [0, rises, 0, falls, 0, rises, falls]


def test_an_input_that_is_on_at_run_is_a_rising_edge() -> None:
    rig = Rig("LDP X0 / OUT Y0")
    assert [rig.scan(X0=1).bit("Y0"), rig.scan().bit("Y0")] == [1, 0]


@pytest.mark.parametrize("join", ["AND", "OR"])
def test_edges_in_series_and_parallel_are_followed_whatever_the_rest_says(join: str) -> None:
    rig = Rig(f"LD X0 / {join}P X1 / {join}F X2 / OUT Y0")
    other = int(join == "OR")  # the state in which the others do not decide
    rig.scan(X0=other, X2=1)
    # The edges happen while X0 hides them: they are past when it lets go.
    rig.scan(X1=1, X2=0)
    assert rig.bit("Y0") == other
    assert rig.scan(X0=1 - other).bit("Y0") == 0


@pytest.mark.parametrize(
    ("test", "holds"),
    [("=", {0}), ("<>", {-1, 1}), (">", {1}), ("<", {-1}), (">=", {0, 1}), ("<=", {-1, 0})],
)
@pytest.mark.parametrize("join", ["LD", "AND", "OR"])
def test_comparisons_are_of_signed_values(test: str, holds: set[int], join: str) -> None:
    front = {"LD": "", "AND": "LD M8000 / ", "OR": "LD M8001 / "}[join]
    for one, other in itertools.product((-32768, -1, 0, 1, 32767), repeat=2):
        sign = (one > other) - (one < other)
        for form in ("", "D"):
            rig = (
                Rig(f"{front}{join}{form}{test} D0 D2 / OUT Y0")
                .put_pair("D0", one)
                .put_pair("D2", other)
                .scan()
            )
            assert rig.bit("Y0") == (sign in holds), (one, other, form)
        assert Rig(f"{front}{join}{test} K{one} K{other} / OUT Y0").scan().bit("Y0") == (sign in holds)


def test_a_32_bit_comparison_sees_both_words() -> None:
    rig = Rig("LDD> D0 K70000 / OUT Y0 / LD> D0 K0 / OUT Y1").put_pair("D0", 70_001).scan()
    assert rig.bits("Y0", "Y1") == [1, 1]
    assert Rig("LDD= K8X0 H10000 / OUT Y0").scan(X20=1).bit("Y0") == 1
    assert Rig("LDD= C200 K-5 / OUT Y0").put(C200=-5).scan().bit("Y0") == 1


def test_a_comparison_out_of_range_does_not_conduct_and_is_an_error() -> None:
    rig = Rig("LD= D8000Z0 K0 / OUT Y0 / LDI M8001 / OR<> D0Z0 K0 / OUT Y1").put(Z0=9000).scan()
    assert rig.bits("Y0", "Y1") == [0, 1]
    assert rig.error() == 6706


def test_index_registers_move_operands() -> None:
    assert always("MOV D0Z1 D9", Z1=3, D3=77).word("D9") == 77
    assert always("MOV D5V D9", V0=-3, D2=78).word("D9") == 78
    assert always("MOV K100Z2 D9", Z2=-1).word("D9") == 99
    assert always("MOV HFFFFZ2 D9", Z2=2).word("D9") == 1
    # Octal: X0 and eight on is X10.
    assert Rig("LD M8000 / MOV K1X0Z0 D9").put(Z0=8).scan(X10=1, X12=1).word("D9") == 5
    assert always("MOV K3 K1Y0Z0", Z0=8).bits("Y10", "Y11", "Y12") == [1, 1, 0]
    assert always("CMP K1 K1 M0Z0", Z0=5).bits("M5", "M6", "M7") == [0, 1, 0]


@pytest.mark.parametrize(
    ("text", "index"),
    [("MOV D0Z0 D1", 8256), ("MOV D0Z0 D1", -1), ("MOV K1 D8255Z0", 1), ("MOV K4M3070Z0 D0", 5000), ("MOV K1 K1Y0Z0", 253),
     ("DMOV K1 D8254Z0", 1), ("MOV C190Z0 D0", 10), ("DMOV C200Z0 D0", 56), ("CMP K1 K1 M3069Z0", 1), ("ALT M3071Z0", 1),
     ("XCH D0 D1Z0", 8300), ("BMOV D0Z0 D1 K10", 8250), ("FMOV K0 D8250Z0 K5", 2), ("SFTL X0 M0Z0 K8 K1", 3065)],
)  # fmt: skip
def test_an_index_beyond_the_range_is_an_error_and_the_instruction_is_skipped(text: str, index: int) -> None:
    text = text.replace("K4M3070Z0", "K4M3000Z0")
    rig = Rig(f"LD M8000 / {text}").put(Z0=index, D0=7, D1=8).scan()
    assert rig.error() == 6706
    assert (rig.word("D0"), rig.word("D1")) == (7, 8)
    assert rig.word("D8069") == 1  # the step of the instruction behind LD


@pytest.mark.parametrize("others", [("OR M0", "AND X1"), ("AND X1", "OR M0"), ("INV", "OR M0"), ("INV",)])
def test_the_longest_condition_can_be_carried_out(others: tuple[str, ...]) -> None:
    """200 contacts, nested as deep as they can be; M0 is off and X1 on."""
    following = list(itertools.islice(itertools.cycle(others), 199))
    rig = Rig(" / ".join(["LD X0", *following, "OUT Y0"]))
    turned = following.count("INV") % 2
    assert [rig.scan(X0=on, X1=1).bit("Y0") for on in (0, 1)] == [turned, 1 - turned]
