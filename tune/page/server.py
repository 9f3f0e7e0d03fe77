"""The page over HTTP: who may ask, for which files, and commands that run with their progress.

Everything stands below a random token, on the loopback address only, for requests that name that
address as their host. Files are those of one folder, links followed. They are written by the
commands and by what a person saves, whole or not at all, with backups.
"""

from __future__ import annotations

import asyncio
import json
import os
import re
import secrets
import socket
import sys
from collections.abc import AsyncGenerator, Callable
from contextlib import asynccontextmanager, suppress
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import uvicorn
from pydantic import ValidationError
from starlette.applications import Starlette
from starlette.exceptions import HTTPException
from starlette.middleware import Middleware
from starlette.middleware.trustedhost import TrustedHostMiddleware
from starlette.requests import Request
from starlette.responses import FileResponse, JSONResponse, Response, StreamingResponse
from starlette.routing import Mount, Route

import identification as ident
from identification import Document, IdentificationError
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
#: What a person may save from a form, and the comment that each begins with.
_FORMS: dict[str, tuple[type[Document], str]] = {
    "hardware": (ident.Hardware, "Stated by a person; numbers in SI units."),
    "scene": (Scene, "What is to be felt; 'haptune new scene' explains every key."),
}
#: Commands that the page runs, and what follows each of their options.
_COMMANDS = frozenset(["doctor", "export", "identify", "new", "report", "tune"])
_TEXTS = frozenset(["--time", "--force", "--position", "--reference", "--to"]) | {
    f"--{role}-gain" for role in ("time", "force", "position")
}
_PATHS = frozenset(["-o", "--hardware", "--device", "--picture"])
#: A picture that is to be looked at, not kept.
_SHOWN = re.compile(r"@(\w+\.png)")
_SCHEMA = re.compile(rb"^schema: haptune/(\w+)/", re.MULTILINE)
#: Files that are listed at most, and bytes of each that are looked at.
_MOST_FILES, _HEAD = 1000, 4096
#: Seconds between two signs of life, and after the last tab was closed: a reload takes less.
_BEAT, _GRACE = 0.5, 3.0
#: A command, of what this page itself is made of: nothing in the folder takes its place.
_PROGRAM = "import sys; sys.path[:] = {path!r}; from tune.cli import main; main()"


def serve(folder: Path, port: int, tell: Callable[[str], None]) -> None:
    """Serve a folder until a signal comes or the last tab is closed; ``tell`` gets the address.

    Port 0 takes any that is free. Raises OSError where the port is taken.
    """
    with socket.socket() as door, TemporaryDirectory(prefix="haptune-") as shown:
        door.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        door.bind(("127.0.0.1", port))
        door.listen()
        page = Page(folder=folder.resolve(), shown=Path(shown))
        tell(f"http://127.0.0.1:{door.getsockname()[1]}/{page.token}/")
        page.server.run(sockets=[door])


class Page:
    """One folder on one address: its token, the tabs that look at it, the command that runs."""

    def __init__(self, *, folder: Path, shown: Path) -> None:
        self.folder, self.shown = folder, shown
        self.token = secrets.token_urlsafe(24)
        self.tabs = 0
        self.process: asyncio.subprocess.Process | None = None
        own: list[Route] = [
            Route("/", self.own_file),
            Route("/{name:str}", self.own_file),
            Route("/alive/", self.alive),
            Route("/folder/", self.listing),
            Route("/file/{path:path}", self.file),
            Route("/log/", self.log, methods=["POST"]),
            Route("/read/", self.read, methods=["POST"]),
            Route("/move/", self.move, methods=["POST"]),
            Route("/save/", self.save, methods=["POST"]),
            Route("/drop/{path:path}", self.drop, methods=["PUT"]),
            Route("/run/", self.run, methods=["POST"]),
            Route("/stop/", self.stop, methods=["POST"]),
        ]
        kinds = (IdentificationError, TuneError, ValidationError)
        app = Starlette(
            routes=[Mount("/" + self.token, routes=own)],
            middleware=[Middleware(TrustedHostMiddleware, allowed_hosts=["127.0.0.1"])],
            exception_handlers=dict.fromkeys(kinds, _refused),
            lifespan=self._life,
        )
        settings = uvicorn.Config(
            app, log_level="error", access_log=False, timeout_graceful_shutdown=2
        )
        self.server = uvicorn.Server(settings)

    @asynccontextmanager
    async def _life(self, _: Starlette) -> AsyncGenerator[None]:
        """A command that still runs is asked to end, and ends what it writes, before the page."""
        yield
        if self._end() and self.process is not None:
            await self.process.wait()

    def path(self, name: str) -> Path:
        """A path within the folder, links followed; any other is refused, but @NAME to look at."""
        if shown := _SHOWN.fullmatch(name):
            return self.shown / shown[1]
        try:
            found = (self.folder / name).resolve()
        except (OSError, ValueError):
            raise HTTPException(400, "no path") from None
        if not found.is_relative_to(self.folder):
            raise HTTPException(403, "outside of the folder")
        return found

    async def own_file(self, request: Request) -> Response:
        """The page itself, its style and script."""
        name = request.path_params.get("name", "index.html")
        return _sent(_STYLE if name == _STYLE.name else _STATIC / Path(name).name, _OWN)

    async def file(self, request: Request) -> Response:
        """A file of the folder, such as a report; nothing in it can run."""
        return _sent(self.path(request.path_params["path"]), _FOREIGN)

    async def alive(self, request: Request) -> Response:
        """Beats as long as a tab looks; when the last has gone, the page ends."""

        async def beats() -> AsyncGenerator[bytes]:
            self.tabs += 1
            try:
                while not (self.server.should_exit or await request.is_disconnected()):
                    yield b"."
                    await asyncio.sleep(_BEAT)
            finally:
                self.tabs -= 1
                asyncio.get_running_loop().call_later(_GRACE, self._leave)

        return StreamingResponse(beats())

    def _leave(self) -> None:
        self.server.should_exit |= not self.tabs

    async def listing(self, _: Request) -> Response:
        """Files of the folder with their kinds, and the known devices."""
        found = [
            {"name": path.name, "kind": kind, "bytes": path.stat().st_size}
            for path in sorted(self.folder.iterdir())[:_MOST_FILES]
            if path.is_file() and (kind := _kind_of(path))
        ]
        known = list(ident.named_devices())
        return JSONResponse({"folder": str(self.folder), "files": found, "devices": known})

    async def log(self, request: Request) -> Response:
        """Columns of a log, thinned."""
        asked = views.LogAsked.model_validate(await request.json())
        return JSONResponse(await asyncio.to_thread(views.log_view, self.path(asked.file), asked))

    async def read(self, request: Request) -> Response:
        """A YAML document as it stands, and what is to be seen of it."""
        name = str((await request.json())["file"])
        known = name in ident.named_devices()
        path = name if known else self.path(name)
        return JSONResponse(await asyncio.to_thread(views.document_view, path))

    async def move(self, request: Request) -> Response:
        """What gains amount to, as ``haptune audit`` tells it, with region and responses."""
        asked = views.Moved.model_validate(await request.json())
        for name in (asked.device, asked.profile):
            self.path(name)
        return JSONResponse(await asyncio.to_thread(views.moved_view, self.folder, asked))

    async def save(self, request: Request) -> Response:
        """Write a form as the file that it stands for."""
        asked: dict[str, Any] = await request.json()
        model, comment = _FORMS[asked["kind"]]
        path, content = self.path(asked["file"]), asked["content"]
        document = ident.parse_document(model, content, path.name)
        if isinstance(document, Scene) and document.perception != "default":
            self.path(document.perception)
        replaced = ident.write_text(path, ident.to_yaml(content, comment))
        return JSONResponse({"backup": "" if replaced is None else replaced.backup.name})

    async def drop(self, request: Request) -> Response:
        """Put a log into the folder, as somebody dropped it and said so."""
        path = self.path(request.path_params["path"])
        if path.parent != self.folder or _kind_of(path) != "log":
            raise HTTPException(403, "not the name of a log")
        replaced = ident.write_bytes(path, await request.body())
        return JSONResponse({"backup": "" if replaced is None else replaced.backup.name})

    def _checked(self, arguments: list[str]) -> list[str]:
        """Arguments of a command of which every path lies within the folder."""
        command, *rest = arguments
        if command not in _COMMANDS:
            raise HTTPException(403, "no command of the page")
        found, tokens = [command], iter(rest)
        for token in tokens:
            found.append(token)
            name = next(tokens, "") if token in _TEXTS | _PATHS else found.pop()
            if token not in _TEXTS and name.startswith("-"):
                raise HTTPException(403, "no option of the page")
            path = self.path(name) if token not in _TEXTS else None
            found.append(str(path) if _SHOWN.fullmatch(name) else name)
        return found

    async def run(self, request: Request) -> Response:
        """Run a command in the folder: a line of JSON a stage, then its result."""
        arguments = self._checked([str(each) for each in await request.json()])
        if self.process is not None and self.process.returncode is None:
            raise HTTPException(409, "another command runs")
        program = _PROGRAM.format(path=[each for each in sys.path if each])
        self.process = await asyncio.create_subprocess_exec(
            *(sys.executable, "-P", "-c", program, *arguments, "--json"),
            cwd=self.folder,
            env=os.environ | {"HAPTUNE_STAGES": "1"},
            stdin=asyncio.subprocess.DEVNULL,
            stdout=asyncio.subprocess.PIPE,
            stderr=asyncio.subprocess.PIPE,
        )
        return StreamingResponse(self._told(self.process), media_type="application/x-ndjson")

    async def _told(self, process: asyncio.subprocess.Process) -> AsyncGenerator[str]:
        assert process.stdout is not None
        assert process.stderr is not None
        result = asyncio.create_task(process.stdout.read())
        try:
            async for line in process.stderr:
                yield json.dumps({"stage": line.decode(errors="replace").strip()}) + "\n"
            said, code = await result, await process.wait()
            ended = {"exit_code": code, "message": "it was ended", "outputs": (), "findings": ()}
            yield f'{{"result": {said.decode().strip() or json.dumps(ended)}}}\n'
        finally:
            self._end()

    async def stop(self, _: Request) -> Response:
        """Ask the command that runs to end, as Ctrl-C does."""
        return JSONResponse({"asked": self._end()})

    def _end(self) -> bool:
        """Whether a command runs, which is asked to end."""
        if self.process is None or self.process.returncode is not None:
            return False
        with suppress(ProcessLookupError):
            self.process.terminate()
        return True


def _sent(path: Path, policy: str) -> Response:
    """A file that nobody keeps and no other page may show."""
    if not path.is_file():
        raise HTTPException(404)
    headers = {"Content-Security-Policy": policy, "Referrer-Policy": "no-referrer"}
    headers |= {"Cache-Control": "no-store", "X-Content-Type-Options": "nosniff"}
    return FileResponse(path, headers=headers)


def _refused(_: Request, error: Exception) -> Response:
    return JSONResponse({"problem": str(error)}, status_code=422)


def _kind_of(path: Path) -> str:
    """What a file is by its ending, or a YAML document by its schema; "" for neither."""
    if path.suffix != ".yaml":
        return "log" if path.suffix.lower() in ident.LOG_ENDINGS else ""
    with suppress(OSError), path.open("rb") as stream:
        found = _SCHEMA.search(stream.read(_HEAD))
        return "" if found is None else found[1].decode()
    return ""
