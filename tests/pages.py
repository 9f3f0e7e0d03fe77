"""A page served to the test itself, and asked as a browser or as a stranger would ask."""

import json
import threading
from collections.abc import Generator, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass
from http.client import HTTPConnection
from pathlib import Path
from queue import Queue
from typing import Any
from urllib.parse import urlsplit

from tune.page.server import serve


@dataclass(frozen=True, slots=True, kw_only=True)
class Answer:
    """What came back."""

    status: int
    body: bytes

    @property
    def json(self) -> Any:
        """The body as JSON."""
        assert self.status == 200, self.body
        return json.loads(self.body)


@dataclass(frozen=True, slots=True, kw_only=True)
class Served:
    """A page that is served: where, and to whom."""

    address: str

    @property
    def port(self) -> int:
        """Its port."""
        port = urlsplit(self.address).port
        assert port is not None
        return port

    @property
    def token(self) -> str:
        """What its paths begin with."""
        return urlsplit(self.address).path.strip("/")

    def ask(
        self,
        path: str,
        body: object = None,
        *,
        method: str | None = None,
        root: str | None = None,
        host: str | None = None,
    ) -> Answer:
        """One request; a body is sent as JSON, unless it is bytes."""
        sent = body if isinstance(body, bytes) or body is None else json.dumps(body).encode()
        line = HTTPConnection("127.0.0.1", self.port, timeout=60)
        headers = {"Host": host or f"127.0.0.1:{self.port}"}
        root = f"/{self.token}/" if root is None else root
        line.request(method or ("GET" if body is None else "POST"), root + path, sent, headers)
        answer = line.getresponse()
        found = Answer(status=answer.status, body=answer.read())
        line.close()
        return found

    def run(self, *words: str) -> dict[str, Any]:
        """The result of a command."""
        return self.ask("run/", list(words)).json

    def stages(self) -> Iterator[str]:
        """What runs, moment by moment, "" for nothing."""
        line = HTTPConnection("127.0.0.1", self.port, timeout=60)
        line.request("GET", f"/{self.token}/alive/")
        with closing(line), line.getresponse() as beats:
            while beat := beats.readline():
                if beat.startswith(b"data:"):
                    yield beat.decode().removeprefix("data:").strip()


@contextmanager
def served(folder: Path) -> Generator[Served]:
    """A folder on a page, which ends as its last tab is closed."""
    told: Queue[str] = Queue()
    thread = threading.Thread(target=serve, args=(folder, 0, told.put))
    thread.start()
    page = Served(address=told.get(timeout=60))
    tab = HTTPConnection("127.0.0.1", page.port, timeout=60)
    tab.request("GET", f"/{page.token}/alive/")
    beats = tab.getresponse()
    try:
        yield page
    finally:
        beats.close()
        tab.close()
        thread.join(30)
    assert not thread.is_alive(), "the page went on after its last tab"
