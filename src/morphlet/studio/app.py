"""The application: what is answered over HTTP and over the socket.

A page's messages become tasks of the session's thread; what the session tells comes back to the event loop and goes to the pages.
"""

import asyncio
import itertools
import tempfile
from collections.abc import Callable
from contextlib import suppress
from importlib.metadata import version
from pathlib import Path
from typing import Any

from starlette.applications import Starlette
from starlette.requests import ClientDisconnect, Request
from starlette.responses import FileResponse, HTMLResponse, JSONResponse, Response
from starlette.routing import Mount, Route, WebSocketRoute
from starlette.staticfiles import StaticFiles
from starlette.types import ASGIApp, Message, Receive, Scope, Send
from starlette.websockets import WebSocket, WebSocketDisconnect

from morphlet.errors import MorphletError
from morphlet.io.formats import WRITTEN
from morphlet.motion.morph import PATHS
from morphlet.samples.creatures import SAMPLES
from morphlet.studio import messages, saving
from morphlet.studio.access import Access
from morphlet.studio.events import Event, broken, problem, refused
from morphlet.studio.hub import Hub, Outbox, text_of
from morphlet.studio.messages import MOST_TEXT, Refusal
from morphlet.studio.methods import WAYS
from morphlet.studio.model import MOST_VERTICES
from morphlet.studio.session import NEWEST, Session
from morphlet.studio.worker import Worker

MOST_UPLOAD = 256 * 2**20
"""Bytes of a file that is opened."""
MOST_PAGES = 8
"""Pages at a time."""
MOST_WAITING = 1000
"""Commands that may wait; beyond, pages are asked to wait."""
GREETING_SECONDS, FAREWELL_SECONDS = 10.0, 2.0
"""Until a page that says nothing is cut off; until one that takes nothing is left alone."""
STATIC = Path(__file__).parent / "static"
"""The page, as it was bundled."""
NO_PAGE = """<!doctype html><html lang="en"><meta charset="utf-8"><title>morphlet studio</title>
<p>The server runs, but its page was not built into this copy. In the repository: <code>make studio</code>.</p></html>"""
NO_TOKEN = """<!doctype html><html lang="en"><meta charset="utf-8"><title>morphlet studio</title>
<p>This address lacks the token. Use the one that <code>morphlet studio</code> printed.</p></html>"""
TOO_MANY, TOO_SLOW = 1013, 1008
"""Reasons for closing a socket."""
FREE = ("cancel",)
"""Messages that are not held up by a job."""


class Guard:
    """Refuses strangers before anything else is looked at, and puts the rules for browsers on every answer."""

    def __init__(self, app: ASGIApp, access: Access) -> None:
        self.app, self.access = app, access

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass on what comes from a page of this server."""
        if scope["type"] == "lifespan":
            await self.app(scope, receive, send)
            return
        headers = {name.decode("latin-1"): value.decode("latin-1") for name, value in scope["headers"]}
        near = self.access.own_host(headers.get("host")) and self.access.own_origin(headers.get("origin"))
        if scope["type"] == "websocket":
            await (self.app(scope, receive, send) if near else WebSocket(scope, receive, send).close())
            return

        async def with_rules(message: Message) -> None:
            if message["type"] == "http.response.start":
                added = [(name.lower().encode(), value.encode()) for name, value in self.access.headers().items()]
                own = {name for name, _ in added}
                message["headers"] = [pair for pair in message.get("headers", []) if pair[0].lower() not in own] + added
            await send(message)

        stranger = told(
            Refusal("host", "a request to this server from its own page", "another host or origin", "use the printed address"), 403
        )
        await (self.app if near else stranger)(scope, receive, with_rules)


class Studio:
    """One session with its pages.

    Parameters
    ----------
    session
        Made to emit into `tell`.
    access
        Who may talk to it.
    """

    def __init__(self, make: Callable[[Callable[[Event], None]], Session], access: Access) -> None:
        self.access, self.hub = access, Hub()
        self.loop: asyncio.AbstractEventLoop | None = None
        self._early: list[Event] = []
        self.session = make(self.tell)
        self.worker = Worker(self.session.idle, lambda error: self.tell(broken(error, None, None)))
        self._clients, self._uploads = itertools.count(1), asyncio.Semaphore(1)

    def tell(self, event: Event) -> None:
        """Take what the session tells, on its thread, to the event loop."""
        if self.loop is None:
            self._early.append(event)
        else:
            with suppress(RuntimeError):  # the loop has ended, and all pages with it
                self.loop.call_soon_threadsafe(self.hub.take, event)

    def begin(self) -> None:
        """On the event loop, before the first page."""
        for event in self._early:
            self.hub.take(event)
        self._early, self.loop = [], asyncio.get_running_loop()

    def close(self) -> None:
        """Stop what runs, and write what there is."""
        self.session.halt()
        self.worker.put(self.session.end)
        self.worker.close()

    def app(self) -> ASGIApp:
        """What a web server runs."""
        routes = [
            Route("/", self.page, methods=["GET"]),
            Route("/upload", self.upload, methods=["POST"]),
            Route("/save/{what}", self.save, methods=["GET"]),
            WebSocketRoute("/socket", self.socket),
        ]
        if STATIC.is_dir():
            routes.append(Mount("/static", StaticFiles(directory=STATIC)))
        return Guard(Starlette(routes=routes), self.access)

    async def page(self, request: Request) -> Response:
        """The page itself."""
        if not self.access.knows(request.headers, request.query_params):
            return HTMLResponse(NO_TOKEN, 403)
        index = STATIC / "index.html"
        return FileResponse(index) if index.is_file() else HTMLResponse(NO_PAGE, 503)

    async def upload(self, request: Request) -> Response:
        """Open a file that a page sends."""
        if not self.access.knows(request.headers, request.query_params):
            return stranger()
        try:
            slot = messages.choice("source", "target", "pairs", "session")(request.query_params.get("slot"), "slot")
            name = Path(messages.text(request.query_params.get("name"), "name")).name or "mesh"
            if self.session.job is not None or self._uploads.locked():
                raise Refusal("busy", "a free server", "one that works", "wait for it, or cancel")
            async with self._uploads:
                with tempfile.TemporaryDirectory() as folder:
                    place = await received(request, Path(folder, f"upload{Path(name).suffix.lower()}"))
                    await asyncio.wrap_future(self.worker.ask(lambda: self._opened(slot, place, name)))
        except MorphletError as error:
            return told(error)
        except ClientDisconnect:
            return Response(status_code=400)
        return JSONResponse({"done": True})

    async def save(self, request: Request) -> Response:
        """Give a page a file to keep."""
        if not self.access.knows(request.headers, request.query_params):
            return stranger()
        make = saving.WHAT.get(request.path_params["what"])
        if make is None:
            return told(Refusal("field", f"one of {', '.join(saving.WHAT)}", request.path_params["what"], "choose one of these"), 404)
        if self.session.job is not None:
            return told(Refusal("busy", "a free server", "one that works", "wait for it, or cancel"))
        try:
            made = await asyncio.wrap_future(self.worker.ask(lambda: make(self.session, request.query_params)))
        except MorphletError as error:
            return told(error)
        return Response(
            made.data, media_type=made.media_type, headers={"Content-Disposition": f'attachment; filename="{_ascii(made.name)}"'}
        )

    async def socket(self, socket: WebSocket) -> None:
        """One page."""
        if not self.access.knows(socket.headers, socket.query_params):
            await socket.close()
            return
        await socket.accept()
        if len(self.hub.boxes) >= MOST_PAGES:
            await socket.close(TOO_MANY, f"{MOST_PAGES} pages are open")
            return
        client = next(self._clients)
        try:
            with suppress(WebSocketDisconnect, RuntimeError):
                box = await self._greeted(socket, client)
                if box is not None:
                    await self._talk(socket, box)
        finally:
            self.hub.leave(client)
            self.worker.put(lambda: self.session.left(client))

    async def _greeted(self, socket: WebSocket, client: int) -> Outbox | None:
        """Wait for the page's greeting and answer it; None if there is none."""
        try:
            text = await asyncio.wait_for(_heard(socket), GREETING_SECONDS)
            first = messages.parse(text)
            if first.type != "hello":
                raise Refusal("order", "hello first", first.type, "send hello")
            if first["protocol"] != messages.VERSION:
                raise Refusal("protocol", f"protocol {messages.VERSION}", str(first["protocol"]), "reload the page")
        except TimeoutError:
            await socket.close(TOO_SLOW, "no hello")
        except Refusal as error:
            await socket.send_text(text_of(refused(error, None, client).content))
            await socket.close(TOO_SLOW, "no hello")
        else:
            return self.hub.join(client, greeting(client))
        return None

    async def _talk(self, socket: WebSocket, box: Outbox) -> None:
        """Hear and tell until one of both ends, or the page takes nothing any more."""

        async def send(part: str | bytes) -> None:
            await (socket.send_text(part) if isinstance(part, str) else socket.send_bytes(part))

        async def hear() -> None:
            while True:
                self._hear(await _heard(socket), box)

        tasks = [asyncio.create_task(work) for work in (box.run(send), hear(), box.cut.wait())]
        await asyncio.wait(tasks, return_when=asyncio.FIRST_COMPLETED)
        for task in tasks:
            task.cancel()
        await asyncio.gather(*tasks, return_exceptions=True)
        with suppress(TimeoutError):
            await asyncio.wait_for(socket.close(TOO_SLOW, "this page takes no messages"), FAREWELL_SECONDS)

    def _hear(self, text: str, box: Outbox) -> None:
        """One message of a page."""
        try:
            message = messages.parse(text)
        except Refusal as error:
            box.add_note(text_of(refused(error, messages.number_of(text), box.client).content), None)
            return
        try:
            self._pass_on(message, box)
        except Refusal as error:
            box.add_note(text_of(refused(error, message.id, box.client).content), None)

    def _pass_on(self, message: messages.Message, box: Outbox) -> None:
        """To the session's thread, unless it is for the event loop."""
        client, session = box.client, self.session
        if message.type == "ack":
            box.acknowledge(message["frame"])
            return
        if message.type == "hello":
            raise Refusal("order", "one hello", "another one", "leave it out")
        if message.type == "cancel":
            session.stop.set()
        elif session.job is not None or self.worker.waiting > MOST_WAITING:
            raise Refusal("busy", "a free server", "one that works", "wait for it, or cancel")
        key = ("drag" if message.type.startswith("drag.") else message.type, client)
        if message.type in NEWEST or message.values.get("live"):
            overtaken = self.worker.put_newest(key, lambda: session.follow(message, client))
        else:
            overtaken = self.worker.forget(key)
            self.worker.put(lambda: session.handle(message, client))
        before = box.waiting.pop(key, None)
        if overtaken and before is not None:
            box.add_note(text_of({"type": "done", "id": before}), None)
        box.waiting[key] = message.id

    def _opened(self, slot: str, file: Path, name: str) -> None:
        """What an upload is for."""
        if slot == "pairs":
            self.session.read_pairs(file)
        elif slot == "session":
            self.session.read_session(file.read_bytes())
        else:
            self.session.open(slot, file, name)


def greeting(client: int) -> dict[str, Any]:
    """What a page is told first."""
    return {
        "type": "hello",
        "protocol": messages.VERSION,
        "version": version("morphlet"),
        "client": client,
        "limits": {"text": MOST_TEXT, "upload": MOST_UPLOAD, "vertices": MOST_VERTICES, "pages": MOST_PAGES},
        "methods": [way.told() for way in WAYS.values()],
        "samples": list(SAMPLES),
        "easings": ["linear", "smoothstep", "smootherstep"],
        "paths": list(PATHS),
        "formats": list(WRITTEN),
    }


def told(error: MorphletError, status: int | None = None) -> JSONResponse:
    """An error over HTTP."""
    code = error.code if isinstance(error, Refusal) else ""
    chosen = {"order": 409, "busy": 409, "held": 409, "large": 413}.get(code, 400) if status is None else status
    return JSONResponse(problem(error), chosen)


def stranger() -> JSONResponse:
    """The answer to who does not know the token."""
    return told(Refusal("token", "the token of this server", "none, or another one", "use the printed address"), 403)


async def received(request: Request, place: Path) -> Path:
    """The body of a request in a file.

    Raises
    ------
    Refusal
        If it is too large; nothing beyond the limit is taken.
    """
    refusal = Refusal("large", f"a file of at most {MOST_UPLOAD // 2**20} MiB", "a larger one", "simplify the mesh first")
    declared = request.headers.get("content-length", "")
    if declared.isdigit() and int(declared) > MOST_UPLOAD:
        raise refusal
    size = 0
    with open(place, "wb") as stream:
        async for chunk in request.stream():
            size += len(chunk)
            if size > MOST_UPLOAD:
                raise refusal
            stream.write(chunk)
    return place


async def _heard(socket: WebSocket) -> str:
    """The next text of a page; bytes are read as text, since both can be nonsense."""
    message = await socket.receive()
    if message["type"] == "websocket.disconnect":
        raise WebSocketDisconnect(message.get("code", 1000))
    text = message.get("text")
    return text if text is not None else message.get("bytes", b"").decode("utf-8", "replace")


def _ascii(name: str) -> str:
    """A file name that a header can hold."""
    return "".join(letter if letter.isascii() and (letter.isalnum() or letter in "-_.") else "_" for letter in name)
