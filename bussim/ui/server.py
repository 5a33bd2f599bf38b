"""The server of the page: which address is answered by what, and its beginning and end."""

from __future__ import annotations

import json
import secrets
import socket
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Annotated, Any, Literal, TypeVar, cast

import anyio
import uvicorn
from anyio import CapacityLimiter, to_thread
from pydantic import BaseModel, Field, ValidationError
from starlette.applications import Starlette
from starlette.requests import Request
from starlette.responses import HTMLResponse, Response, StreamingResponse
from starlette.routing import Route

from bussim.api import examine, profiles
from bussim.errors import BussimError, ScenarioError, UsageError
from bussim.exact.solution import exact
from bussim.scenario.model import Scenario
from bussim.scenario.yaml.edit import edit
from bussim.started import StartedRun, start
from bussim.ui.counters import CountersAsked, noise_of
from bussim.ui.finished import finished
from bussim.ui.guard import Guard, Refusal, body_of
from bussim.ui.line import Name, Strict, field_of
from bussim.ui.page import static
from bussim.ui.questions import Asked, Desk, SizeAsked
from bussim.ui.workspace import Workspace
from bussim.version import __version__
from bussim.words.language import shown, use_language

#: Reports and sizing pages that can be fetched, and loaded anew: the last ones.
_KEPT = 8
#: Where runs are written, in the workspace.
_RUNS = "runs"

_Kind = TypeVar("_Kind", bound=BaseModel)


class _Empty(Strict):
    pass


class _Id(Strict):
    id: Name


class _Said(_Id):
    lang: Literal["en", "zh"]


class _Save(Asked):
    target: Name
    expected: Name | None = None


class _Run(Asked):
    duration_s: Annotated[float, Field(gt=0, le=1e7)] | None = None
    seed: int | None = None
    trace: bool = True


class _Report(SizeAsked):
    run: Name | None = None


@dataclass
class Service:
    """The addresses of the page and their answers.

    ``report`` writes the page on a run's folder, ``site`` reads the file of a readout: parts of bussim that
    know more than the page does. ``example`` is the text that it begins with; ``end`` ends the server.
    """

    workspace: Workspace
    lang: str
    report: Callable[..., Path]
    site: Callable[[Path], Any]
    example: str
    end: Callable[[], None]
    running: dict[str, StartedRun] = field(default_factory=dict)
    _runs: dict[str, tuple[Path, Scenario]] = field(default_factory=dict)
    _made_pages: dict[str, str] = field(default_factory=dict)
    _beginning: CapacityLimiter = field(default_factory=lambda: CapacityLimiter(1))

    def application(self, port: int, token: str) -> Guard:
        """The application behind its guard."""
        desk = self._desk = Desk(self.workspace)
        answers: dict[str, tuple[type[BaseModel], Callable[[Any], Any]]] = {
            "hello": (_Empty, self._hello),
            "check": (Asked, desk.check),
            "edit": (Asked, desk.check),
            "law": (Asked, desk.law),
            "size": (SizeAsked, desk.size),
            "refresh": (Asked, desk.refresh),
            "counters": (CountersAsked, lambda asked: noise_of(asked, desk.line(asked), self.site)),
            "list": (_Empty, lambda _: {"entries": self.workspace.listing()}),
            "open": (_Id, lambda asked: self.workspace.read(self.workspace.path(asked.id))),
            "save": (_Save, self._save),
            "run/stop": (_Id, self._stop),
            "run/said": (_Said, lambda asked: self._finished(asked.id, asked.lang)),
            "report": (_Report, self._report),
            "quit": (_Empty, self._end),
        }
        routes = [
            Route(f"/api/{name}", _answering(*each), methods=["POST"]) for name, each in answers.items()
        ]
        routes += [
            Route("/api/run", self._run, methods=["POST"]),
            Route("/", self._file),
            Route("/static/{name}", self._file),
            Route("/made/{key}", self._made),
        ]
        handlers = {404: _not_found, 405: _not_found, Exception: _failed}
        return Guard(Starlette(routes=routes, exception_handlers=handlers), port, token)

    async def _file(self, request: Request) -> Response:
        found = static(request.path_params.get("name", ""), self.lang)
        return (
            await _not_found(request, KeyError())
            if found is None
            else Response(found[0], media_type=found[1])
        )

    async def _made(self, request: Request) -> Response:
        """A page made for printing: only who asked for it knows its address. Its policy is its own."""
        text = self._made_pages.get(request.path_params["key"])
        if text is None:
            return await _not_found(request, KeyError())
        policy = "frame-ancestors 'none'; base-uri 'none'; form-action 'none'"
        return HTMLResponse(text, headers={"content-security-policy": policy})

    def _hello(self, _: _Empty) -> dict[str, Any]:
        workspace = self.workspace
        opened, bad = {"text": self.example, "name": "", "id": None, "hash": None}, None
        if workspace.opened is not None:
            try:
                opened = workspace.read(workspace.opened)
            except Refusal as error:  # the page opens another one, or has a line in its tab
                bad = error.said
        return {
            "version": __version__,
            "lang": self.lang,
            "profiles": profiles(),
            "folder": str(workspace.folder),
            "opened": opened,
            "bad": bad,
        }

    def _save(self, asked: _Save) -> dict[str, Any]:
        return self.workspace.save(asked.target, self._desk.line(asked).text, asked.expected)

    def _stop(self, asked: _Id) -> dict[str, Any]:
        if asked.id not in self.running:
            raise Refusal(400, "unknown_id", "no such run is under way")
        self.running[asked.id].stop()
        return {}

    def _finished(self, key: str, lang: str) -> dict[str, Any]:
        if key not in self._runs:
            raise Refusal(400, "unknown_id", "no such run was finished")
        folder, scenario = self._runs[key]
        return {"event": "finished", "folder": str(folder), "id": key, **finished(folder, scenario, lang)}

    def _report(self, asked: _Report) -> dict[str, Any]:
        if asked.run is None:
            text = self._desk.printed(asked)
        elif asked.run in self._runs:
            with TemporaryDirectory() as folder:
                made = self.report(
                    self._runs[asked.run][0], out=Path(folder) / "report.html", lang=asked.lang
                )
                text = made.read_text(encoding="utf-8")
        else:
            raise Refusal(400, "unknown_id", "no such run was finished")
        while len(self._made_pages) >= _KEPT:
            del self._made_pages[next(iter(self._made_pages))]
        key = secrets.token_urlsafe(32)
        self._made_pages[key] = text
        return {"url": f"/made/{key}"}

    def _end(self, _: _Empty) -> dict[str, Any]:
        self.close()
        self.end()
        return {}

    def close(self) -> None:
        """Stop what still runs."""
        for running in list(self.running.values()):
            running.stop()

    async def _run(self, request: Request) -> Response:
        """Begin a simulation, and stream what it says, a line of JSON each."""
        lang = "en"
        try:
            asked = _read(_Run, await body_of(request))
            lang = asked.lang
            key, scenario = await to_thread.run_sync(self._begin, asked, limiter=self._beginning)
        except (Refusal, BussimError) as error:
            return _refused(error, lang)
        said = self._said(key, scenario, asked.lang)
        await anext(said)  # from here on its end is seen to, whatever becomes of the page
        return StreamingResponse(said, media_type="application/x-ndjson")

    def _begin(self, asked: _Run) -> tuple[str, Scenario]:
        if self.running:
            raise Refusal(429, "busy", "a simulation is under way")
        changes: dict[str, object] = {}
        if asked.duration_s is not None:
            changes["duration"] = f"{asked.duration_s:g} s"
        if asked.seed is not None:
            changes["seed"] = asked.seed
        text, files = edit(self._desk.line(asked).text, changes), self._desk.files(asked)
        scenario = examine(text, files=files).get()
        key = secrets.token_urlsafe(9)
        folder = self.workspace.folder / _RUNS / "ui"
        self.running[key] = start(scenario, folder, trace=asked.trace, numbered=True)
        return key, scenario

    async def _said(self, key: str, scenario: Scenario, lang: str) -> AsyncIterator[str]:
        """What a simulation says; a page that is gone stops it."""
        running = self.running[key]
        steps = running.progress()
        try:
            yield ""
            yield _json({"event": "started", "id": key})
            while (step := await to_thread.run_sync(next, steps, None, abandon_on_cancel=True)) is not None:
                yield _json({"event": "progress", **step._asdict()})
            result = await to_thread.run_sync(running.result, abandon_on_cancel=True)
            self._runs[key] = cast("Path", result.folder), scenario
            yield _json(await to_thread.run_sync(self._finished, key, lang))
        except (BussimError, OSError, ValueError) as error:
            yield _json({"event": "stopped" if running.stopped else "failed", "text": str(error)})
        finally:
            running.stop()
            del self.running[key]


def serve(listening: socket.socket, token: str, workspace: Workspace, lang: str, **parts: Any) -> None:
    """Answer a page at a socket of this computer until it asks for the end, or Ctrl-C.

    ``parts`` are those of :class:`Service`.
    """

    def end() -> None:
        server.should_exit = True

    service = Service(workspace, lang, **parts, end=end)
    config = uvicorn.Config(
        service.application(listening.getsockname()[1], token),
        log_config=None,  # it needs a console
        access_log=False,
        ws="none",
        lifespan="off",
        server_header=False,
        proxy_headers=False,
        timeout_keep_alive=600,
        timeout_graceful_shutdown=1,
    )
    server = uvicorn.Server(config)
    threading.Thread(target=_warm, args=(parts["example"],), daemon=True).start()
    try:
        server.run(sockets=[listening])
    finally:
        service.close()


def _warm(example: str) -> None:
    """Import what the first answers need, while the browser begins."""
    exact(examine(example).get(), refresh=False)


def _answering(kind: type[BaseModel], answer: Callable[[Any], Any]) -> Callable[[Request], Any]:
    """An endpoint: JSON of a kind to JSON, two at a time in threads."""
    limiter = CapacityLimiter(2)  # a second one where the first takes long

    async def answered(request: Request) -> Response:
        begun, lang = anyio.current_time(), "en"
        try:
            asked = _read(kind, await body_of(request))
            lang = asked.lang if isinstance(asked, Asked) else lang
            found = await to_thread.run_sync(answer, asked, limiter=limiter)
            with use_language(lang):
                found = shown(found)
        except (Refusal, BussimError) as error:
            return _refused(error, lang)
        spent = 1000 * (anyio.current_time() - begun)
        return Response(
            _json(found), media_type="application/json", headers={"server-timing": f"answer;dur={spent:.1f}"}
        )

    return answered


def _read(kind: type[_Kind], data: Any) -> _Kind:
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_input=False, include_context=False)[0]
        where = ".".join(map(str, first["loc"]))
        raise Refusal(400, "body", f"{where}: {first['msg']}", {"field": where}) from None


def _refused(error: Refusal | BussimError, lang: str) -> Response:
    with use_language(lang):
        if isinstance(error, ScenarioError):
            found = [shown(each) for each in error.problems]
            problems = [{**asdict(each), "field": field_of(each.path)} for each in found]
            error = Refusal(400, "mistakes", "\n".join(map(str, found)), {"problems": problems})
        elif not isinstance(error, Refusal):
            error = Refusal(400, "refused" if isinstance(error, UsageError) else "failed", error.args[0])
        error.text = shown(error.text)
    return error.response


async def _not_found(_: Request, __: Exception) -> Response:
    return Refusal(404, "no_address", "there is no such address").response


async def _failed(_: Request, error: Exception) -> Response:
    return Refusal(500, "fault", f"a mistake of bussim itself: {type(error).__name__}: {error}").response


def _json(data: Any) -> str:
    return json.dumps(data, ensure_ascii=False, allow_nan=False, separators=(",", ":")) + "\n"
