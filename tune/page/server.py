"""The page over HTTP: who may ask, for which files, and commands that run with their progress.

Everything stands below a random token, on the loopback address only, for requests that name that
address as their host. Files are those of one folder, links followed. They are written by the
commands and by what a person saves, whole or not at all, with backups.
"""

from __future__ import annotations

import asyncio
import os
import re
import secrets
import socket
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager, suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

import uvicorn
from pydantic import TypeAdapter, ValidationError
from pydantic_core import to_json
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

import identification as ident
from identification import IdentificationError
from tune.documents import TuneError
from tune.documents.scene import Scene
from tune.page import views

#: Nothing but what the page itself brings; a page of the folder may not even run a script.
_OWN = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
_FOREIGN = "sandbox; default-src 'none'; style-src 'unsafe-inline'; img-src data:"
_STATIC = Path(__file__).parent / "static"
_STYLE = Path(__file__).parents[1] / "templates" / "report.css"
#: Commands that the page runs, their options that are followed by a path, and by anything else.
_COMMANDS = frozenset(["doctor", "export", "identify", "new", "report", "tune"])
_PATHS = frozenset(["-o", "--hardware", "--device", "--picture"])
_TEXT = re.compile(r"--(((time|force|position)(-gain)?)|reference|to)=[^\0]*")
#: What is asked for: words of a command, or of a view; bytes at most, of a log of 1e6 rows.
_WORDS, _ASKED, _LARGEST = TypeAdapter(list[str]), TypeAdapter(dict[str, Any]), 200_000_000
_SCHEMA = re.compile(rb"^schema: haptune/(\w+)/", re.MULTILINE)
#: A command, of what this page itself is made of: nothing in the folder takes its place.
_PROGRAM = "import sys; sys.path[:] = {path!r}; from tune.cli import main; main()"


def serve(folder: Path, port: int, tell: Callable[[str], None]) -> None:
    """Serve a folder until a signal comes or the last tab is closed; ``tell`` gets the address."""
    # Named as TCP, asyncio sends an answer's body without waiting until its head has arrived.
    with socket.socket(proto=socket.IPPROTO_TCP) as door:
        door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        door.bind(("127.0.0.1", port))
        door.listen()
        page = Page(folder.resolve())
        tell(f"http://127.0.0.1:{door.getsockname()[1]}/{page.token}/")
        page.server.run(sockets=[door])


class Page:
    """One folder on one address: its token, the tabs that look at it, the command that runs."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.token = secrets.token_urlsafe(24)
        self.tabs = 0
        self.process: asyncio.subprocess.Process | None = None
        self.running = asyncio.Lock()
        self.stage = ""
        routes = [
            Route("/alive/", self.alive),
            Route("/folder/", self.listing),
            Route("/file/{path:path}", self.file, methods=["GET", "PUT"]),
            Route("/show/{view}", self.show, methods=["POST"]),
            Route("/run/", self.run, methods=["POST"]),
            Route("/stop/", self.stop, methods=["POST"]),
            Route("/{name:path}", self.own_file),
        ]
        kinds = (IdentificationError, TuneError, OSError, UnicodeDecodeError, ValidationError)
        app = Starlette(
            routes=[Mount("/" + self.token, routes=routes)],
            exception_handlers=dict.fromkeys(kinds, _refused),
            lifespan=self._life,
        )
        local = TrustedHostMiddleware(app, allowed_hosts=["127.0.0.1"])
        config = uvicorn.Config(local, log_level="error", timeout_graceful_shutdown=2)
        self.server = uvicorn.Server(config)

    @asynccontextmanager
    async def _life(self, _: Starlette) -> AsyncGenerator[None]:
        """A command that still runs is asked to end, and ends what it writes, before the page."""
        yield
        if self._end() and self.process is not None:
            await self.process.wait()

    def path(self, name: str) -> Path:
        """A path within the folder, links followed; any other is refused."""
        try:
            found = (self.folder / name).resolve()
        except ValueError:
            raise HTTPException(400, "no path") from None
        if not found.is_relative_to(self.folder):
            raise HTTPException(403, "outside of the folder")
        return found

    async def own_file(self, request: Request) -> Response:
        """The page itself, its style and script."""
        name = Path(request.path_params["name"]).name or "index.html"
        return _sent(_STYLE if name == _STYLE.name else _STATIC / name, _OWN)

    async def file(self, request: Request) -> Response:
        """A file of the folder, in which nothing can run; or one that a person puts there."""
        path = self.path(request.path_params["path"])
        if request.method == "GET":
            return _sent(path, _FOREIGN)
        if int(request.headers.get("content-length", _LARGEST + 1)) > _LARGEST:
            raise HTTPException(413, f"more than {_LARGEST} bytes: put the file there yourself")
        content = await request.body()
        if path.suffix == ".yaml":
            mapping = ident.load_mapping(path, content.decode())
            if str(mapping.get("schema")).startswith("haptune/hardware/"):
                # In the order of its file; a scene stays as it was written.
                facts = ident.parse_document(ident.Hardware, mapping, path.name)
                text = ident.to_yaml(ident.to_mapping(facts), "Stated by a person; SI units.")
                content = text.encode()
            else:
                self.path(ident.parse_document(Scene, mapping, path.name).perception)
            if _kind_of(path) not in {"", "hardware", "scene"}:
                raise HTTPException(403, "would replace what only a command writes")
        elif path.parent != self.folder or _kind_of(path) != "log":
            raise HTTPException(403, "not the name of a log")
        replaced = ident.write_bytes(path, content)
        return JSONResponse({"backup": "" if replaced is None else replaced.backup.name})

    async def alive(self, _: Request) -> Response:
        """What runs, an event a beat, as long as a tab looks; when the last has gone, it ends."""

        async def beats() -> AsyncGenerator[str]:
            self.tabs += 1
            try:
                while not self.server.should_exit:
                    yield f"data: {self.stage}\n\n"
                    await asyncio.sleep(0.2)
            finally:
                self.tabs -= 1
                wait = 0.0 if self.server.should_exit else 3.0  # s: a reload takes less
                asyncio.get_running_loop().call_later(wait, self._leave)

        return StreamingResponse(beats(), media_type="text/event-stream")

    def _leave(self) -> None:
        if not self.tabs:
            self.server.should_exit = True
            self._end()

    async def listing(self, _: Request) -> Response:
        """Files of the folder by their kind, at most a thousand."""
        found: dict[str, list[str]] = {}
        for path in sorted(self.folder.iterdir())[:1000]:
            if path.is_file():
                found.setdefault(_kind_of(path), []).append(path.name)
        return JSONResponse({"folder": str(self.folder), "files": found})

    async def show(self, request: Request) -> Response:
        """What there is to be seen of a log, a document, or gains that were moved."""
        view: Any = getattr(views, f"{request.path_params['view']}_view", None)
        if view is None:
            raise HTTPException(404)
        asked = _ASKED.validate_json(await request.body())
        told = await asyncio.to_thread(view, self.path, **asked)
        content = to_json(told, inf_nan_mode="null", fallback=lambda array: array.tolist())
        return Response(content, media_type="application/json")

    async def run(self, request: Request) -> Response:
        """Run a command in the folder; every tab is told its stages, who asked its result."""
        words = _WORDS.validate_json(await request.body())
        if not _COMMANDS.intersection(words[:1]):
            raise HTTPException(403, "no command of the page")
        for before, word in pairwise(words):
            if before not in _PATHS and (word in _PATHS or _TEXT.fullmatch(word)):
                continue
            if word.startswith("-"):
                raise HTTPException(403, "no option of the page")
            self.path(word)
        if self.running.locked():
            raise HTTPException(409, "another command runs")
        async with self.running:
            program = _PROGRAM.format(path=[each for each in sys.path if each])
            self.process = process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-c", program, *words, "--json"),
                cwd=self.folder,
                env=os.environ | {"HAPTUNE_STAGES": "1"},
                stdin=asyncio.subprocess.DEVNULL,
                stdout=asyncio.subprocess.PIPE,
                stderr=asyncio.subprocess.PIPE,
            )
            assert process.stdout is not None
            assert process.stderr is not None
            self.stage, reading = "starting", asyncio.create_task(process.stdout.read())
            async for line in process.stderr:
                self.stage = line.decode(errors="replace").strip()
            said, code = await reading, await process.wait()
            self.stage = ""
            ended = {"exit_code": code, "message": "it was ended", "outputs": (), "findings": ()}
            return Response(said or to_json(ended), media_type="application/json")

    async def stop(self, _: Request) -> Response:
        """Ask the command that runs to end, as Ctrl-C does."""
        return JSONResponse({"asked": self._end()})

    def _end(self) -> bool:
        """Whether a command runs, which is asked to end."""
        if self.process is None or self.process.returncode is not None:
            return False
        self.process.terminate()
        return True


def _refused(_: Request, error: Exception) -> Response:
    return Response(str(error), status_code=422, media_type="text/plain")


def _sent(path: Path, policy: str) -> Response:
    """A file that nobody keeps and no other page may show."""
    if not path.is_file():
        raise HTTPException(404)
    headers = {"Content-Security-Policy": policy, "Referrer-Policy": "no-referrer"}
    headers |= {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
    return FileResponse(path, headers=headers)


def _kind_of(path: Path) -> str:
    """What a file is by its ending, or a YAML document by a schema at its head; "" for neither."""
    if path.suffix != ".yaml":
        return "log" if path.suffix.lower() in ident.LOG_ENDINGS else ""
    with suppress(OSError), path.open("rb") as stream:
        found = _SCHEMA.search(stream.read(4096))
        return "" if found is None else found[1].decode()
    return ""
