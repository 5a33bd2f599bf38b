"""Every sentence of a verdict by its key: one table, in which another language is another column.

A sentence names its values in braces. Beside the formats of Python it knows ``n`` (a whole number with its
thousands apart), ``ms`` and ``most_ms`` (milliseconds, see :func:`in_ms`), ``list`` (names), ``counts``
(words with how often), ``codes`` and ``exceptions`` (counts by code, with what each means), ``meanings``
(what codes mean) and ``cause`` (why a link scan was long).
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from string import Formatter
from typing import Any, NamedTuple


class Sentence(NamedTuple):
    """A sentence in each language; ``fault``: it says that something was wrong."""

    en: str
    fault: bool = False


def _fault(en: str) -> Sentence:
    return Sentence(en, fault=True)


#: The languages of the catalogue.
LANGUAGES = ("en",)

SENTENCES: Mapping[str, Sentence] = {
    # -- a link as a whole
    "median": Sentence("{bus}: the median link scan takes {median_ms:ms}."),
    "median_p99": Sentence(
        "{bus}: the median link scan takes {median_ms:ms}, 99 in 100 take at most {p99_ms:most_ms}."
    ),
    "mean": Sentence("{bus}: the mean link scan takes {mean_ms:ms}."),
    "longest": Sentence(
        "{bus}: the longest link scan took {max_ms:most_ms}, {max_at_s:.2f} s after the start."
    ),
    "longest_because": Sentence(
        "{bus}: the longest link scan took {max_ms:most_ms}, {max_at_s:.2f} s after the start, because "
        "{cause:cause}."
    ),
    "no_station_in_error": Sentence("{bus}: no station was in error, and none lost the master."),
    "no_bus": Sentence("The scenario has no bus: every PLC ran by itself, and there were no link scans."),
    "settings_refused": _fault(
        "{plc} refuses its N:N settings: M8063 is on, D8063 = {code:d} (bad parameters), and it sends "
        "nothing."
    ),
    "mode_refused": _fault(
        "{plc} does not know the refresh mode of the master: it takes no part in the link."
    ),
    "no_master": _fault("{bus} has no working master (station number 0), so there was no link scan."),
    "no_scan": _fault(
        "{bus}: no link scan was completed; no station received anything of the master {master}: it was "
        "without supply or in STOP, or the cable beside it was interrupted."
    ),
    "too_short": Sentence("{bus}: the run is too short for a complete link scan."),
    "master_lost": _fault(
        "{bus}: {stations:list} lost the master {master} at {from_s:.2f} s for {for_s:.2f} s (in each D8211 "
        "= 11H and D8203 counted, M8183 on meanwhile); link scans not made: {scans_missed:n}. {master} was "
        "without supply or in STOP."
    ),
    "master_still_lost": _fault(
        "{bus}: {stations:list} lost the master {master} at {from_s:.2f} s and had not found it again when "
        "the run ended, {for_s:.2f} s later (in each D8211 = 11H, D8203 counted, M8183 on); link scans not "
        "made: {scans_missed:n}. {master} was without supply or in STOP."
    ),
    "master_not_received": _fault(
        "{bus}: {stations:list} lost the master {master} at {from_s:.2f} s for {for_s:.2f} s (D8211 = 11H, "
        "D8203 counted, M8183 on meanwhile), while it went on with link scans."
    ),
    "master_paused": _fault(
        "{bus}: the master {master} made no link scan from {from_s:.3f} s for {for_s:.3f} s; no station's "
        "watchdog on it expired (D8211 = 11H in none)."
    ),
    "two_masters": _fault("{bus} has {number:n} masters, {masters:list}: their frames collide."),
    "same_number": _fault(
        "{plcs:list} have the same station number {station} on {bus}: they reply at the same time."
    ),
    "not_polled": _fault(
        "{plc} has station number {station}, but the master of {bus} polls only {slaves:n}."
    ),
    "no_frame": _fault(
        "{node} sent what is no frame (jabber); frames on {bus} that began while its driver was on: "
        "{frames:n}."
    ),
    "late_release": _fault(
        "{node} releases its driver late; frames on {bus} that began while it was still on after its own: "
        "{frames:n}."
    ),
    "collisions": _fault(
        "{bus}: frames that began while another station was sending (collisions): {frames:n}."
    ),
    "collisions_with": _fault(
        "{bus}: frames that began while {nodes:list} still sent (collisions): {frames:n}; a reply came after "
        "the timeout, or a station sent that was not polled."
    ),
    "undetected": _fault(
        "{bus}: damaged frames taken as good: {frames:n}; how often that happens rests on the assumed "
        "frame layout."
    ),
    "repeated": Sentence("{bus}: attempts failed and a later one was successful: {codes:codes}."),
    # -- a slave that was in error
    "station_error": _fault(
        "{station} on {bus} was in error for {for_s:.3f} s in all: station errors (link scans in which every "
        "attempt failed) {errors:n}, onsets {onsets:n}; {codes:codes}."
    ),
    "station_still_in_error": _fault(
        "{station} on {bus} was in error for {for_s:.3f} s in all and still is at the end: station errors "
        "(link scans in which every attempt failed) {errors:n}, onsets {onsets:n}; {codes:codes}."
    ),
    "cause_missing": _fault("No PLC with the number of {station} is on {bus}."),
    "cause_refused": _fault("{station} refuses its parameters (D8063 = {code:d}), so it sends no reply."),
    "cause_stopped": _fault(
        "{station} was without supply or in STOP: it gave no reply, and afterwards it had lost the master's "
        "parameters."
    ),
    "cause_still_stopped": _fault(
        "{station} is without supply or in STOP at the end: it gives no reply and has no parameters."
    ),
    "cause_unreached": _fault(
        "{station} runs but never received the master's parameters: the cable to it, its port, speed or "
        "format is wrong."
    ),
    "cause_cut": _fault(
        "{station} received nothing of the master either (D8211 = 11H): the cable between them was "
        "interrupted."
    ),
    "cause_format": _fault(
        "{station} received the master's frames damaged and lost the master (D8211 = 14H, then 11H): its "
        "speed or format is not that of {bus}, the bus is disturbed there, or a cable was cut within a frame."
    ),
    "cause_damaged": _fault(
        "The replies of {station} arrived damaged (04): noise, or another sender on {bus}."
    ),
    "cause_late": _fault(
        "{station} replied too late: its reply takes longer than the timeout of {timeout_ms:g} ms and meets "
        "a later attempt or another frame."
    ),
    "cause_no_reply": _fault(
        "{station} received the master and gave no reply in time (01): its replies were lost, or take longer "
        "than the timeout of {timeout_ms:g} ms."
    ),
    # -- Modbus masters
    "own_data": Sentence("{node}: requests answered with their own data: all of {requests:n}."),
    "own_data_times": Sentence(
        "{node}: requests answered with their own data: all of {requests:n}; the {which} response time is "
        "{response_ms:ms}, the longest {max_ms:most_ms}."
    ),
    "some_own_data": Sentence("{node}: requests answered with their own data: {own:n} of {requests:n}."),
    "some_own_data_times": Sentence(
        "{node}: requests answered with their own data: {own:n} of {requests:n}; the {which} response "
        "time is {response_ms:ms}, the longest {max_ms:most_ms}."
    ),
    "no_own_data": _fault("{node}: requests answered with their own data: none of {requests:n}."),
    "mistaken": _fault(
        "{node} took responses to other requests for its own, {responses:n} in all: the values are those of "
        "other registers, and no error shows it."
    ),
    "late": _fault(
        "{node}: responses that came after its timeout of {timeout_ms:g} ms, when the request had been given "
        "up: {responses:n}."
    ),
    "no_response": _fault("{node}: requests without any response: {requests:n} ({polls:list})."),
    "damaged_responses": _fault("{node}: responses that arrived damaged: {reasons:counts}."),
    "exceptions": _fault("{node}: exception responses: {codes:exceptions}."),
    "requests_repeated": Sentence(
        "{node}: requests that failed and were repeated with success: {requests:n}."
    ),
    "requests_ignored": _fault("{node} ignored frames that were no sound request: {reasons:counts}."),
    "port_refused": _fault("{node} refuses its parameters: M8063 is on, D8063 = {code:d}, and it is silent."),
    # -- free protocol
    "messages": Sentence("{node}: messages sent {sent:n}, received {received:n}."),
    "messages_ended": _fault("{node}: receptions that ended by timeout: {number:n}."),
    "characters_damaged": _fault("{node}: characters that arrived damaged (parity or framing): {number:n}."),
    # -- why a link scan was long
    "long_all_failed": Sentence("{station} failed all its {number:n} attempts ({codes:meanings})"),
    "long_only_failed": Sentence("{station} failed its only attempt ({codes:meanings})"),
    "long_repeated": Sentence("{station} replied only at attempt {number:n} (before: {codes:meanings})"),
    "long_parameters": Sentence("the master sent its parameters again"),
    # -- error codes of the N:N link (FX communication manual JY992D69901, chapter 4)
    "code_01": Sentence("no reply within the timeout"),
    "code_02": Sentence("a reply with another station's number"),
    "code_03": Sentence("a reply with another counter, such as one that came too late"),
    "code_04": Sentence("a damaged reply"),
    "code_11": Sentence("the master's frames stopped"),
    "code_14": Sentence("a damaged frame of the master"),
    "code_21": Sentence("a station whose poll got no reply"),
    "code_22": Sentence("another station's number received"),
    "code_23": Sentence("another counter received"),
    "code_31": Sentence("polled before it had parameters"),
    "code_other": Sentence("code {code}"),
    # -- exception codes of Modbus (application protocol V1.1b3, section 7; 07: Modicon PI-MBUS-300)
    "exception_01": Sentence("illegal function"),
    "exception_02": Sentence("illegal address"),
    "exception_03": Sentence("illegal value"),
    "exception_04": Sentence("device failure"),
    "exception_05": Sentence("acknowledge"),
    "exception_06": Sentence("device busy"),
    "exception_07": Sentence("negative acknowledge"),
    "exception_08": Sentence("memory parity error"),
    "exception_0A": Sentence("gateway path unavailable"),
    "exception_0B": Sentence("gateway target failed to respond"),
    "exception_other": Sentence("unknown"),
    # -- the yy of D8063 = 7xyy (PW10 board manual, section 8)
    "port_error_00": Sentence("slave address setting"),
    "port_error_01": Sentence("frame length"),
    "port_error_02": Sentence("address"),
    "port_error_03": Sentence("CRC or LRC"),
    "port_error_04": Sentence("unsupported function"),
    "port_error_05": Sentence("reception"),
    "port_error_06": Sentence("data"),
    "port_error_07": Sentence("buffer overflow"),
    "port_error_08": Sentence("framing"),
    "port_error_09": Sentence("no response in time"),
    "port_error_other": Sentence("the port board"),
    # -- parts of sentences
    "and": Sentence(" and "),
    "then": Sentence(", then "),
    "station": Sentence("station {number} ({plc})"),
    "station_number": Sentence("station {number}"),
    "program": Sentence("driven by the program"),
    "which_median": Sentence("median"),
    "which_mean": Sentence("mean"),
}

_GIVEN_UP = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) attempts?, (?:all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)
_REPEATED = re.compile(
    r"(station \d+(?: \(.*\))?): (\d+) failed attempts? before the (?:answer|reply), "
    r"(?:all )?([0-9A-F]{2}(?:, [0-9A-F]{2})*)"
)


def render(key: str, values: Mapping[str, Any] | None = None, lang: str = "en") -> str:
    """A sentence with its values in a language. Raises KeyError where there is no such sentence."""
    text = _Text(lang).vformat(getattr(SENTENCES[key], lang), (), values or {})
    return text[:1].upper() + text[1:] if text.endswith(".") and text.startswith("station ") else text


def is_fault(key: str) -> bool:
    """Whether a sentence says that something was wrong; one of a later version does not."""
    return key in SENTENCES and SENTENCES[key].fault


def meaning(code: str, lang: str = "en", *, kind: str = "code") -> str:
    """What two digits mean, in words: a ``code`` of the N:N link, an ``exception``, a ``port_error``."""
    key = f"{kind}_{code}"
    return render(key if key in SENTENCES else f"{kind}_other", {"code": code}, lang)


def cause_in_words(cause: str, lang: str = "en") -> str:
    """The cause of a link scan in ``summary.json`` as the part of a sentence after "because"."""
    return render("and", lang=lang).join(_reason(reason, lang) for reason in cause.split("; "))


def _reason(reason: str, lang: str) -> str:
    if found := _GIVEN_UP.fullmatch(reason):
        station, number, codes = found.groups()
        key = "long_only_failed" if number == "1" else "long_all_failed"
        return render(key, {"station": station, "number": int(number), "codes": codes}, lang)
    if found := _REPEATED.fullmatch(reason):
        station, number, codes = found.groups()
        return render("long_repeated", {"station": station, "number": int(number) + 1, "codes": codes}, lang)
    return render("long_parameters", lang=lang) if reason == "parameter frame" else reason


def in_ms(value: float, *, most: bool = False) -> str:
    """Milliseconds for a sentence, with one decimal; from 1000 on seconds with two.

    ``most``: rounded up, for what is said not to be exceeded.
    """
    scaled = value / 10 if value >= 1000 else value * 10
    # Up from the nanoseconds that a summary has, not from what a binary fraction adds to them.
    steps = math.ceil(round(scaled, 7)) if most else round(scaled)
    return f"{steps / 100:,.2f} s" if value >= 1000 else f"{steps / 10:,.1f} ms"


class _Text(Formatter):
    """Formats the values of a sentence."""

    def __init__(self, lang: str) -> None:
        self._lang = lang

    def format_field(self, value: Any, format_spec: str) -> str:
        """See :mod:`bussim.results.verdict.catalogue`."""
        match format_spec:
            case "n":
                return f"{value:,}"
            case "ms" | "most_ms":
                return in_ms(value, most=format_spec == "most_ms")
            case "list":
                *others, last = value
                return render("and", lang=self._lang).join([", ".join(others), last] if others else [last])
            case "counts":
                return ", ".join(f"{what} {number:,}×" for what, number in value.items())
            case "codes" | "exceptions":
                kind = "code" if format_spec == "codes" else "exception"
                return ", ".join(
                    f"{code} {number:,}× ({meaning(code, self._lang, kind=kind)})"
                    for code, number in value.items()
                )
            case "meanings":
                words = dict.fromkeys(meaning(code, self._lang) for code in value.split(", "))
                return render("then", lang=self._lang).join(words)
            case "cause":
                return cause_in_words(value, self._lang)
            case _:
                return str(super().format_field(value, format_spec))
