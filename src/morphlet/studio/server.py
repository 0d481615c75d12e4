"""The server: it listens, tells the address, and runs until it is interrupted.

`serve` runs on the calling thread; `Running` on a thread of its own, for tests and notebooks.
"""

import asyncio
import logging
import socket
import sys
import threading
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING

from morphlet.errors import FileError, InputError, MissingExtra, MorphletError, SolveError
from morphlet.studio import recovery
from morphlet.studio.access import EVERYWHERE, Access, is_local, new_token
from morphlet.studio.messages import MOST_TEXT
from morphlet.studio.session import Session

if TYPE_CHECKING:
    import uvicorn

    from morphlet.studio.app import Studio

HOST, MOST_PORT = "127.0.0.1", 65535
SIDES = ("source", "target")
NEEDED = ("starlette", "uvicorn", "websockets")
START_SECONDS, STOP_SECONDS = 20.0, 2.0
"""Until the server listens; until pages that do not go by themselves are cut off."""
POLL_SECONDS = 0.01
PUBLIC = "this address can be reached from other machines: whoever sees the token can edit; use it in networks that you trust alone"
"""What is said of any address but this machine's own."""


def require_extra() -> None:
    """Say what to install where the server's libraries are missing.

    Raises
    ------
    MissingExtra
        If one of them is.
    """
    missing = [name for name in NEEDED if find_spec(name) is None]
    if missing:
        raise MissingExtra("the studio's libraries", f"no {', '.join(missing)}", "pip install 'morphlet[studio]'")


class Running:
    """A server on a thread of its own, from `with` to its end.

    Parameters
    ----------
    meshes
        Files of the source and the target, as many as there are.
    host, port
        Where to listen; port 0 for any free one.
    folder
        Where sessions are kept; `recovery.home()` if left out.
    names
        Further host names under which it is reached.

    Raises
    ------
    MissingExtra
        If the server's libraries are missing.
    InputError
        If there are more than two meshes, or there is no such port.
    FileError
        If the address is taken.
    """

    def __init__(
        self, meshes: Sequence[Path] = (), *, host: str = HOST, port: int = 0, folder: Path | None = None, names: tuple[str, ...] = ()
    ) -> None:
        require_extra()
        if len(meshes) > len(SIDES):
            raise InputError("at most two meshes, source and target", str(len(meshes)), "open the others in the page")
        if not 0 <= port <= MOST_PORT:
            raise InputError(f"a port from 0 to {MOST_PORT}", str(port), "choose another, or 0 for any free one")
        self.host, self.listening = host, _listening(host, port)
        self.port = int(self.listening.getsockname()[1])
        self.access = Access.of(new_token(), host, self.port, (*names, *(_own_names() if host in EVERYWHERE else ())))
        self._root = recovery.home() if folder is None else folder
        self._meshes = tuple(meshes)
        self._started, self._thread = threading.Event(), threading.Thread(target=self._run_apart, name="morphlet-server", daemon=True)
        self._server: uvicorn.Server | None = None
        self._failure: MorphletError | None = None
        self.studio: Studio | None = None

    @property
    def url(self) -> str:
        """The address with its token."""
        name = f"[{self.host}]" if ":" in self.host else self.host
        return f"http://{EVERYWHERE.get(self.host, name)}:{self.port}/?token={self.access.token}"

    def run(self, ready: Callable[[], object] = lambda: None) -> None:
        """Open the meshes and serve until `stop`, or an interruption.

        Raises
        ------
        MorphletError
            If a mesh cannot be opened.
        """
        from morphlet.studio.app import Studio

        folder = recovery.Folder.create(self._root)
        self.studio = Studio(lambda emit: Session(folder, emit), self.access)
        try:
            for side, mesh in zip(SIDES, self._meshes, strict=False):
                self.studio.worker.ask(partial(self._session.open, side, mesh, mesh.name)).result()
            self.studio.worker.ask(self._session.tell).result()
            self.studio.worker.put(self._session.warm_up)
            self._serve(self.studio, ready)
        finally:
            self.studio.close()
            self.listening.close()

    def stop(self) -> None:
        """End it."""
        if self._server is not None:
            self._server.should_exit = True

    def __enter__(self) -> "Running":
        self._thread.start()
        if not self._started.wait(START_SECONDS):
            raise SolveError(f"a server within {START_SECONDS:g} s", "none", "close other programs, or try again")
        if self._failure is not None:
            raise self._failure
        return self

    def __exit__(self, *error: object) -> None:
        self.stop()
        self._thread.join()

    def _run_apart(self) -> None:
        """`run`, its failure kept for who waits for the start."""
        try:
            self.run()
        except MorphletError as error:
            self._failure = error
        finally:
            self._started.set()

    @property
    def _session(self) -> Session:
        if self.studio is None:
            raise SolveError("a server that runs", "one that does not", "start it first")
        return self.studio.session

    def _serve(self, studio: "Studio", ready: Callable[[], object]) -> None:
        import uvicorn

        config = uvicorn.Config(
            studio.app(), log_config=None, log_level=logging.CRITICAL, access_log=False, lifespan="off", server_header=False,
            ws_max_size=MOST_TEXT, ws_per_message_deflate=False, timeout_graceful_shutdown=int(STOP_SECONDS),
        )  # fmt: skip
        self._server = uvicorn.Server(config)
        with asyncio.Runner() as runner:
            runner.run(self._listen(self._server, studio, ready))

    async def _listen(self, server: "uvicorn.Server", studio: "Studio", ready: Callable[[], object]) -> None:
        """Serve, and say when pages can come."""
        studio.begin()
        serving = asyncio.create_task(server.serve([self.listening]))
        while not server.started and not serving.done():
            await asyncio.sleep(POLL_SECONDS)
        self._started.set()
        ready()
        await serving


def serve(
    meshes: Sequence[Path] = (),
    *,
    host: str = HOST,
    port: int = 0,
    names: tuple[str, ...] = (),
    say: Callable[[str], object] = lambda text: None,
    ready: Callable[[str], object] = lambda url: None,
) -> None:
    """Serve the studio until it is interrupted.

    Parameters
    ----------
    meshes
        Files of the source and the target, as many as there are.
    host, port
        Where to listen: this machine alone unless told otherwise; port 0 for any free one.
    names
        Further host names under which the server is reached, where it does not listen on this machine alone.
    say
        Told what a person should know: the address; a warning if other machines can reach it.
    ready
        Told the address with its token, once the server listens: opens the browser.

    Raises
    ------
    MissingExtra
        If the server's libraries are missing.
    MorphletError
        If a mesh cannot be opened, or the address is taken.

    Examples
    --------
    >>> from morphlet.studio.server import serve
    >>> serve(["one.obj", "two.obj", "three.obj"])
    Traceback (most recent call last):
        ...
    morphlet.errors.InputError: needed at most two meshes, source and target; found 3; open the others in the page
    """
    running = Running([Path(mesh) for mesh in meshes], host=host, port=port, names=names)
    if not is_local(host):
        say(PUBLIC)

    def listens() -> None:
        say(f"morphlet studio: {running.url}  (end with Ctrl-C)")
        ready(running.url)

    with suppress(KeyboardInterrupt):  # how a person ends it
        running.run(listens)


def _own_names() -> list[str]:
    """Names and addresses of this machine, as far as it knows them."""
    try:
        name, aliases, addresses = socket.gethostbyname_ex(socket.gethostname())
    except OSError:
        return [socket.gethostname()]
    return [name, *aliases, *addresses]


def _listening(host: str, port: int) -> socket.socket:
    """A socket that listens there."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    opened = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)  # named, or asyncio lets small messages wait for others
    try:
        if sys.platform != "win32":  # where it would let another program take the address
            opened.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        opened.bind((host, port))
    except OSError as error:
        opened.close()
        raise FileError(f"a free address {host}:{port}", str(error), "choose another port, or 0 for any") from error
    return opened
