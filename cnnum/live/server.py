"""The server of the pages: static files and a WebSocket, for this machine alone by default."""

import asyncio
import contextlib
import hmac
import ipaddress
import json
import logging
from collections.abc import AsyncGenerator, Callable, Mapping, Sequence
from contextlib import asynccontextmanager
from dataclasses import dataclass
from http import HTTPStatus
from importlib import resources
from pathlib import PurePath
from typing import TYPE_CHECKING, Any, cast
from urllib.parse import parse_qs, quote, urlsplit

from cnnum.errors import PortError, SceneError, missing_extra
from cnnum.live.feeds import Feed
from cnnum.live.hub import Hub
from cnnum.scenes.frame_path import FrameResult
from cnnum.sharing import json_value

if TYPE_CHECKING:
    from websockets.asyncio.server import Server, ServerConnection
    from websockets.http11 import Request, Response

PICTURES = 60.0
"""Pictures a second, at most."""

WHY, STATUS = 6, 30
"""Pictures from one message of read-outs, or of the status, to the next."""

BEHIND = 1 << 18
"""Bytes that wait for a slow page; it is left out until it has taken them."""

KINDS = {
    ".html": "text/html; charset=utf-8",
    ".css": "text/css; charset=utf-8",
    ".js": "text/javascript; charset=utf-8",
}

VIEW = ("index.html", "view.css", "view.js", "program.js")
"""Files of the live view, the page itself first."""

POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; connect-src 'self'; img-src data:"
)

LONGEST = 4096
"""Bytes of a page's command."""


@dataclass(frozen=True, slots=True)
class Place:
    """Where the page is, and who may read it.

    Attributes
    ----------
    host : str
        Address that is listened at.
    port : int
        0 for any that is free.
    token : str
        Token that a page must present; empty if none is required.

    Raises
    ------
    SceneError
        If others than this machine could connect and no token is set, or the token is not text.
    """

    host: str = "127.0.0.1"
    port: int = 8765
    token: str = ""

    def __post_init__(self) -> None:
        if not is_loopback(self.host) and not self.token:
            raise SceneError(
                f"'{self.host}' can be reached from other machines: set a token, which the page's "
                "address must then contain."
            )
        try:
            self.token.encode()
        except UnicodeEncodeError:
            raise SceneError(
                "The token must be text: use letters, digits and punctuation."
            ) from None

    def address(self, port: int) -> str:
        """Return the page's address in a browser."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{name}:{port}/" + (
            f"?token={quote(self.token, safe='')}" if self.token else ""
        )


def is_loopback(host: str) -> bool:
    """Return whether only this machine reaches an address."""
    if host == "localhost":
        return True
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return False


class Gate:
    """Lets in the page itself alone.

    A page of another origin is refused by its `Origin`. One that has made its own name lead here
    (DNS rebinding) is refused by its `Host`. That is not needed where a token is asked for, which
    it cannot know.

    Parameters
    ----------
    place : Place
    """

    def __init__(self, place: Place) -> None:
        self._place = place

    def refusal(self, headers: Mapping[str, str], path: str) -> str:
        """Return why a WebSocket is refused; empty if it is accepted."""
        host, origin = headers.get("Host", ""), headers.get("Origin")
        if refusal := self.stranger(host):
            return refusal
        if origin is not None and origin != f"http://{host}":
            return "A page of another origin cannot read this stream."
        given = parse_qs(urlsplit(path).query).get("token", [""])[0]
        if self._place.token and not hmac.compare_digest(
            given.encode(), self._place.token.encode()
        ):
            return "The address lacks the token that this server asks for."
        return ""

    def stranger(self, host: str) -> str:
        """Return why a host name is refused; empty if it is this server's."""
        name = urlsplit(f"//{host}").hostname or ""
        known = is_loopback(name) if is_loopback(self._place.host) else bool(self._place.token)
        return "" if known else "This server is reached by another name."


def static(path: str, files: Sequence[str] = VIEW) -> tuple[HTTPStatus, str, bytes]:
    """Return status, type and bytes of a file of the page, whose first file is the page itself."""
    name = urlsplit(path).path.lstrip("/") or files[0]
    if name not in files:
        return HTTPStatus.NOT_FOUND, "text/plain; charset=utf-8", b"There is no such page.\n"
    file = resources.files("cnnum.live") / "static" / name
    return HTTPStatus.OK, KINDS[PurePath(name).suffix], file.read_bytes()


class Door:
    """Gives out the files of a page, and lets its WebSocket in.

    Attributes
    ----------
    longest : int
        Bytes of a message that the page may send.
    """

    longest = LONGEST

    def __init__(self, place: Place, files: Sequence[str] = VIEW) -> None:
        self.place, self._files, self._gate = place, files, Gate(place)

    def answer(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        """Answer a request for a file, or let a WebSocket in."""
        try:
            return self._answer(connection, request)
        except (ValueError, LookupError):  # a host that is none, a header that is there twice
            return connection.respond(HTTPStatus.BAD_REQUEST, "This request is malformed.\n")

    def _answer(self, connection: "ServerConnection", request: "Request") -> "Response | None":
        wants_socket = request.headers.get("Upgrade", "").lower() == "websocket"
        if not wants_socket:
            if refusal := self._gate.stranger(request.headers.get("Host", "")):
                return connection.respond(HTTPStatus.FORBIDDEN, refusal + "\n")
            status, kind, body = static(request.path, self._files)
            response = connection.respond(status, "")
            for name, value in _headers(kind, body):
                if name in response.headers:
                    del response.headers[name]
                response.headers[name] = value
            response.body = body
            return response
        refusal = self._gate.refusal(request.headers, request.path)
        return connection.respond(HTTPStatus.FORBIDDEN, refusal + "\n") if refusal else None

    async def talk(self, connection: "ServerConnection") -> None:
        """Speak with a page until it leaves."""
        raise NotImplementedError


class Pages(Door):
    """The pages of a feed that are open, and the pictures sent to them."""

    def __init__(self, feed: Feed, place: Place) -> None:
        super().__init__(place)
        self._feed = feed
        self._open: set[ServerConnection] = set()
        self._seen: dict[ServerConnection, tuple[Sequence[int], FrameResult | None]] = {}
        self.pictures = self.late = 0

    async def talk(self, connection: "ServerConnection") -> None:
        """Greet a page, and follow its commands until it leaves."""
        from websockets.exceptions import ConnectionClosed

        with contextlib.suppress(ConnectionClosed):
            hubs = self._feed.hubs
            skins = [hub.hello() for hub in hubs]
            await connection.send(json.dumps({"kind": "hello", "skins": skins}))
            # a source that has ended or is paused has nothing newer for a page that comes late
            for skin, hub in enumerate(hubs):
                if picture := hub.picture(None, skin)[1]:
                    await connection.send(picture)
                if (why := hub.why(again=True)) is not None:
                    await connection.send(json.dumps(json_value({**why, "skin": skin})))
            self._open.add(connection)
            try:
                async for message in connection:
                    self._heed(connection, message)
            finally:
                self._open.discard(connection)
                self._seen.pop(connection, None)

    def _heed(self, connection: "ServerConnection", message: str | bytes) -> None:
        try:
            wanted: Any = json.loads(message)
        except (ValueError, RecursionError):
            return
        if not isinstance(wanted, dict):
            return
        known, inside = cast("dict[str, Any]", wanted), self._feed.hubs[0].inside
        if inside is not None and isinstance(nodes := known.get("nodes"), list):
            self._seen[connection] = inside.known(cast("list[object]", nodes)), None
        else:
            self._feed.command(known)

    async def show(self) -> None:
        """Send a picture 60 times a second, read-outs 10 times, a status twice, events at once."""
        hubs = self._feed.hubs
        shown: list[FrameResult | None] = [None for _ in hubs]
        sent = [hub.count for hub in hubs]
        loop = asyncio.get_running_loop()
        due, count = loop.time(), 0
        while True:
            due = max(due + 1.0 / PICTURES, loop.time())
            await asyncio.sleep(due - loop.time())
            for skin, hub in enumerate(hubs):
                shown[skin], sent[skin] = self._once(skin, hub, shown[skin], sent[skin], count)
            count += 1

    def _ready(self) -> "set[ServerConnection]":
        """Return the pages that keep up."""
        return {c for c in self._open if c.transport.get_write_buffer_size() < BEHIND}

    def _once(
        self, skin: int, hub: Hub, shown: FrameResult | None, sent: int, count: int
    ) -> tuple[FrameResult | None, int]:
        from websockets.asyncio.server import broadcast

        sent, events = hub.events_since(sent)
        if not self._open:
            return shown, sent
        if events:
            self._send(json.dumps({"kind": "events", "skin": skin, "events": events}), always=True)
        shown, picture = hub.picture(shown, skin)
        if picture:
            self.pictures += 1
            self._send(picture)
        if count % WHY == 0 and (why := hub.why()) is not None:
            self._send(json.dumps(json_value({**why, "skin": skin})))
        if count % WHY == 0 and hub.inside is not None and (newest := hub.newest) is not None:
            for page in self._ready():
                nodes, known = self._seen.get(page, ((), None))
                if nodes and newest is not known and newest.values is not None:
                    self._seen[page] = nodes, newest
                    broadcast([page], hub.inside.encoded(newest, nodes))
        if count % STATUS == 0:
            self._send(json.dumps({**hub.status(), "skin": skin, "late": self.late}))
        return shown, sent

    def _send(self, message: str | bytes, *, always: bool = False) -> None:
        """Send to every page that keeps up."""
        from websockets.asyncio.server import broadcast

        ready = self._ready()
        self.late += len(self._open) - len(ready)
        broadcast(self._open if always else ready, message)


def _headers(kind: str, body: bytes) -> list[tuple[str, str]]:
    return [
        ("Content-Type", kind),
        ("Content-Length", str(len(body))),
        ("Content-Security-Policy", POLICY),
        ("X-Content-Type-Options", "nosniff"),
        ("Cross-Origin-Resource-Policy", "same-origin"),
        ("Referrer-Policy", "no-referrer"),
        ("Cache-Control", "no-store"),
    ]


def _quiet_logger() -> logging.Logger:
    """Return the logger of the library: what others send is no reason for a traceback here."""
    logger = logging.getLogger("cnnum.view")
    logger.setLevel(logging.ERROR)
    if not logger.filters:
        logger.addFilter(lambda record: record.msg != "opening handshake failed")
    return logger


@asynccontextmanager
async def listening(door: Door, what: str) -> "AsyncGenerator[tuple[Server, int]]":
    """Let pages in while the block runs; yields the server and its port.

    Raises
    ------
    MissingExtraError
        If the library is not installed.
    PortError
        If the port cannot be listened at.
    """
    try:
        from websockets.asyncio.server import serve
    except ImportError:
        raise missing_extra(what, "websockets", "view") from None
    place = door.place
    try:
        server = await serve(
            door.talk,
            place.host,
            place.port,
            process_request=door.answer,
            max_size=door.longest,
            compression=None,
            close_timeout=1.0,
            server_header=None,
            logger=_quiet_logger(),
        )
    except OSError as error:
        raise PortError(
            f"{what.capitalize()} cannot listen at '{place.host}' port {place.port} "
            f"({error.strerror}): choose another with --port, or 0 for any that is free."
        ) from None
    try:
        yield server, int(server.sockets[0].getsockname()[1])
    finally:
        server.close()
        await server.wait_closed()


@asynccontextmanager
async def serving(feed: Feed, place: Place) -> "AsyncGenerator[tuple[Server, Pages, int]]":
    """Serve a feed while the block runs; yields the server, its pages and its port.

    Raises
    ------
    MissingExtraError, PortError
        As `listening`.
    """
    pages = Pages(feed, place)
    async with listening(pages, "the live view") as (server, port):
        feed.start()
        shows = asyncio.create_task(pages.show())
        try:
            yield server, pages, port
        finally:
            shows.cancel()
            await asyncio.to_thread(feed.stop)


def run(feed: Feed, place: Place, ready: Callable[[str], object]) -> None:
    """Serve a feed until Ctrl-C; `ready` is given the page's address."""

    async def forever() -> None:
        async with serving(feed, place) as (_, _, port):
            ready(place.address(port))
            await asyncio.Event().wait()

    asyncio.run(forever())


def run_door(
    door: Door, what: str, ready: Callable[[str], object], feed: Feed | None = None
) -> None:
    """Let pages in until Ctrl-C; `ready` is given the page's address, and a feed runs meanwhile."""

    async def forever() -> None:
        async with listening(door, what) as (_, port):
            ready(door.place.address(port))
            if feed is not None:
                feed.start()
            try:
                await asyncio.Event().wait()
            finally:
                if feed is not None:
                    await asyncio.to_thread(feed.stop)

    asyncio.run(forever())
