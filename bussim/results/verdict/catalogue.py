"""Every sentence of a verdict by its key: one table, in which another language is another column.

A sentence names its values in braces. Beside the formats of Python it knows ``n`` (a whole number with its
thousands apart), ``ms`` and ``most_ms`` (milliseconds, see :func:`in_ms`), ``list`` (names), ``counts``
(words with how often), ``codes`` and ``exceptions`` (counts by code, with what each means), ``meanings``
(what codes mean), ``cause`` (why a link scan was long), ``when`` (how often, for how long, and when
longest), ``times`` (of responses, or nothing), ``devices`` (special devices of the link by name) and
``serial`` (a code of D8063).
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


#: What a sentence says after what was seen.
_CUT = ": the cable between them was interrupted, or a port is wrong"
_DAMAGE = ": noise, lost characters, another sender on {bus}, or rates, formats or clocks that differ"
_NOT_READY = ': "reception complete" was not reset, or no instruction that receives was driven'


def _request(en: str) -> str:
    return "{node}: failed requests to {peer}: {requests:n}, {when:when}; " + en + "."


def _message(en: str) -> str:
    return "{node}: messages of {peer} received " + en + "; in all {messages:n}, {when:when}."


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
        "{plc} refuses its N:N settings: {flag} is on, {error} = {code:d} (bad parameters), and it sends "
        "nothing."
    ),
    "mode_refused": _fault(
        "{plc} does not know the refresh mode of the master: it takes no part in the link."
    ),
    "no_master": _fault("{bus} has no working master (station number 0), so there was no link scan."),
    "no_scan": _fault(
        "{bus}: no link scan was completed; no station received anything of the master {master}."
    ),
    "too_short": Sentence("{bus}: the run is too short for a complete link scan."),
    "not_running": _fault("{plc} was {state:part} {when:when}."),
    "still_not_running": _fault("{plc} was {state:part} {when:when}, and still is when the run ends."),
    "master_lost": _fault(
        "{bus}: {stations:list} lost the master {master} {when:when} (in each {error} = 11H and {count} "
        "counted, {flag} on meanwhile); link scans not made: {scans_missed:n}."
    ),
    "master_still_lost": _fault(
        "{bus}: {stations:list} lost the master {master} {when:when} and had not found it again when the run "
        "ended (in each {error} = 11H, {count} counted, {flag} on); link scans not made: {scans_missed:n}."
    ),
    "master_not_received": _fault(
        "{bus}: {stations:list} lost the master {master} {when:when} ({error} = 11H, {count} counted, {flag} "
        "on meanwhile), while it went on with link scans."
    ),
    "master_paused": _fault(
        "{bus}: the master {master} made no link scan {when:when}; link scans not made: {scans_missed:n}. No "
        "station's watchdog on it expired ({error} = 11H in none)."
    ),
    "master_stopped": _fault(
        "{bus}: the master {master} made no link scan {when:when}, up to the end of the run; link scans not "
        "made: {scans_missed:n}. No station's watchdog on it had expired by then ({error} = 11H in none)."
    ),
    "master_damaged": _fault(
        "{bus}: damage that counts as that of frames of the master {master} ({error} = 14H, {count} counted, "
        "{flag} on until its next sound frame) came to {stations:counts}: noise, lost characters, another "
        "sender, rate or format, or frames cut short; where {flag} was on longest, it was on {when:when}."
    ),
    "two_masters": _fault("{bus} has {number:n} masters, {masters:list}: their frames collide."),
    "same_number": _fault(
        "{plcs:list} have the same station number {station} on {bus}: they reply at the same time."
    ),
    "not_polled": _fault(
        "{plc} has station number {station}, but the master of {bus} polls only {slaves:n}."
    ),
    "no_frame": _fault(
        "{node} sent what is no frame (jabber) {when:when}; frames on {bus} that began meanwhile: {frames:n}."
    ),
    "late_release": _fault(
        "{node} released its driver late {when:when}; frames on {bus} that began while it was still on after "
        "its own: {frames:n}."
    ),
    "late_replies": _fault(
        "{node} replied too late on {bus} {when:when}; replies that ended after the timeout, and so met a "
        "later attempt or another frame: {frames:n}."
    ),
    "pauses": _fault(
        "{node} paused inside its frames on {bus} for two characters or more, which ends a frame, "
        "{when:when}; such frames: {frames:n}."
    ),
    "other_rate": _fault(
        "{node} sent with another rate, format or clock than that of {bus} {when:when}; such frames: "
        "{frames:n}."
    ),
    "collisions": _fault(
        "{bus}: frames that began while another station was sending (collisions): {frames:n}."
    ),
    "collisions_with": _fault(
        "{bus}: frames that began while {nodes:list} still sent (collisions): {frames:n}; a reply came after "
        "its timeout, or a node sent that was not asked."
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
    "undecided": _fault(
        "{station} on {bus} gave no good reply {when:when}, when the run or the master's work ended before "
        "its last attempt: no station error came of it."
    ),
    "cause_missing": _fault("No PLC with the number of {station} is on {bus}."),
    "cause_refused": _fault("{station} refuses its parameters ({error} = {code:d}), so it sends no reply."),
    "cause_cut": _fault(
        "{station} was in RUN, and nothing of the master came to it, in most attempts not one character, "
        "{when:when}: the cable between them was interrupted, or its port is wrong."
    ),
    "cause_format": _fault(
        "{station} received characters, but no whole data frame of the master {when:when}: its rate, format "
        "or clock is not that of {bus}, or noise covered the frames."
    ),
    "cause_noisy": _fault(
        "{station} failed {when:when} while it received frames of the master now whole, now damaged: noise "
        "at it or on {bus}, or lost characters."
    ),
    "cause_master": _fault(
        "{stations:list} failed {when:when} while the frames of the master {master} came whole to no "
        "station, or damaged to all: its driver, port, rate or format, the cable beside it, or noise."
    ),
    "cause_receiver": _fault(
        "Replies of {stations:list} failed at the master {master} {when:when} although other stations "
        "received them: noise at it, the cable beside it, or its port."
    ),
    "cause_damaged": _fault(
        "The replies of {station} arrived damaged (04) {when:when}: noise, lost characters, another sender "
        "on {bus}, or clocks that differ."
    ),
    "cause_mistaken": _fault(
        "Replies with another number or counter (02, 03) arrived when {station} was polled {when:when}: "
        "replies that came too late, or of a station with a wrong number."
    ),
    "cause_no_reply": _fault(
        "{station} received the master, and no reply of it arrived in time (01) {when:when}: it sent none, "
        "noise covered polls or replies, or they take longer than the timeout of {timeout_ms:g} ms."
    ),
    "shown": _fault(
        "{bus}: {plc} shows {devices:devices}, which follows from nothing else that was found: frames did "
        "not reach it whole, as with noise at it alone; the cause is not known."
    ),
    # -- serial errors of a PLC
    "serial_error": _fault(
        "{plc} shows a serial error that is over: {flag} is off, {error} = {code:serial}."
    ),
    "serial_error_on": _fault("{plc} shows a serial error: {flag} is on, {error} = {code:serial}."),
    # -- Modbus masters
    "own_data": Sentence("{node}: requests answered with their own data: all of {requests:n}{times:times}."),
    "some_own_data": Sentence(
        "{node}: requests answered with their own data: {own:n} of {requests:n}{times:times}."
    ),
    "no_own_data": _fault("{node}: requests answered with their own data: none of {requests:n}."),
    "mistaken": _fault(
        "{node} took responses to other requests for its own, {responses:n} in all, {when:when}: the values "
        "are those of other registers, and no error shows it."
    ),
    "late": _fault(
        "{node}: responses that came after its timeout of {timeout_ms:g} ms, when the request had been given "
        "up: {responses:n}, {when:when}."
    ),
    "no_response": _fault("{node}: requests without any response: {requests:n} ({polls:list})."),
    "damaged_responses": _fault("{node}: responses that arrived damaged: {reasons:counts}."),
    "exceptions": _fault("{node}: exception responses, {when:when}: {codes:exceptions}."),
    "requests_repeated": Sentence(
        "{node}: requests that failed and were repeated with success: {requests:n}."
    ),
    "requests_ignored": _fault("{node} ignored frames that were no sound request: {reasons:counts}."),
    "port_refused": _fault("{node} refuses its parameters: M8063 is on, D8063 = {code:d}, and it is silent."),
    "broadcasts": Sentence("{node}: broadcasts, which get no response: {requests:n}."),
    # -- why requests of a Modbus master failed
    "request_missing": _fault(
        "{node}: requests to station {peer}, which no node at work on {bus} was: {requests:n}, {when:when}."
    ),
    "request_deaf": _fault(_request("{peer} was at work and received no character of them" + _CUT)),
    "request_garbled": _fault(_request("{peer} received them damaged" + _DAMAGE)),
    "request_joined": _fault(
        _request(
            "{peer} received them together with another frame, as the silence between them was too short: "
            "{node} began too early, or a late reply came"
        )
    ),
    "request_silent": _fault(_request("{peer} received them whole and sent no reply in time")),
    "request_reply_lost": _fault(_request("{peer} replied, and nothing of that arrived" + _CUT)),
    "request_reply_damaged": _fault(_request("replies of {peer} arrived damaged" + _DAMAGE)),
    "request_unknown": Sentence(
        "{node}: failed requests to {peer} whose cause is not known, as they failed in another way than most "
        "around them, or met a response to another request: {requests:n}."
    ),
    # -- free protocol
    "messages": Sentence("{node}: messages sent {sent:n}, received {received:n}."),
    "messages_whole": Sentence("{node}: messages of {peer} received whole: all of {messages:n}."),
    "messages_some": Sentence("{node}: messages of {peer} received whole: {whole:n} of {messages:n}."),
    "message_damaged": _fault(_message("damaged, as errors of characters or a missing end show" + _DAMAGE)),
    "message_wrong": _fault(_message("with other characters, which no flag shows" + _DAMAGE)),
    "message_deaf": _fault(_message("not at all, though it was ready" + _CUT)),
    "message_not_ready": _fault(_message("not, as it was not ready" + _NOT_READY)),
    "message_passed": Sentence(_message("not, as it was not ready" + _NOT_READY)),
    "messages_ended": _fault(
        "{node} waited in vain for the first character of a reply until its timeout: {number:n}, {when:when}."
    ),
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
    "port_error_48": Sentence("bad parameters"),
    "port_error_other": Sentence("the port board"),
    # -- parts of sentences
    "without_supply": Sentence("without supply"),
    "in_stop": Sentence("in STOP"),
    "once": Sentence("from {from_s:.3f} s on for {for_s:.3f} s"),
    "at_once": Sentence("at {from_s:.3f} s"),
    "apart": Sentence("{times:n} times between {first_s:.3f} s and {last_s:.3f} s"),
    "several_times": Sentence(
        "{times:n} times between {first_s:.3f} s and {last_s:.3f} s, for {total_s:.3f} s in all, the longest "
        "time from {from_s:.3f} s on for {for_s:.3f} s"
    ),
    "and": Sentence(" and "),
    "then": Sentence(", then "),
    "station": Sentence("station {number} ({plc})"),
    "station_number": Sentence("station {number}"),
    "program": Sentence("driven by the program"),
    "median_times": Sentence("; the median response time is {p50:ms}, the longest {max:most_ms}"),
    "mean_times": Sentence("; the mean response time is {mean:ms}, the longest {max:most_ms}"),
    "times_unknown": Sentence("at times that were not kept"),
}

#: Sentences of folders of earlier versions, which have their texts.
_FORMER_FAULTS = frozenset({"cause_late", "cause_stopped", "cause_still_stopped", "cause_unreached"})
#: Error codes are in D8211 to D8218, of an FX1S in D211 to D218; counts lie below.
_FIRST_CODE = 11
#: The 7 of 7xyy, PW10's codes in D8063 (its board manual, section 8).
_PW10 = 7
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
    return SENTENCES[key].fault if key in SENTENCES else key in _FORMER_FAULTS


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
            case "when":
                if value is None:  # in a folder of an earlier version
                    return render("times_unknown", lang=self._lang)
                several, lasts = value["times"] > 1, value["for_s"]
                key = "several_times" if lasts else "apart"
                return render(key if several else "once" if lasts else "at_once", value, self._lang)
            case "times":
                which = "" if value["max"] is None else "mean" if value["p50"] is None else "median"
                return which and render(f"{which}_times", value, self._lang)
            case "part":
                return render(value, lang=self._lang)
            case "devices":
                return ", ".join(self._device(name, number) for name, number in value.items())
            case "serial":
                port, error = divmod(value % 1000, 100)
                what = f" (COM{port}: {meaning(f'{error:02}', self._lang, kind='port_error')})"
                return f"{value}{what if value // 1000 == _PW10 else ''}"
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

    def _device(self, name: str, number: int) -> str:
        """A special device and what it holds; an error code in hexadecimal digits, with its meaning."""
        if name.startswith("M"):
            return f"{name} on"
        if int(name[-2:]) < _FIRST_CODE:
            return f"{name} = {number:,}"
        code = f"{number:02X}"
        return f"{name} = {code}H ({meaning(code, self._lang)})"
