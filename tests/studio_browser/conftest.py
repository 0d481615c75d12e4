"""One browser for all tests of a run; for each test a server of its own, and windows on it."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from morphlet import Mesh, write
from studio_browser.window import Window, chromium


@pytest.fixture(scope="session")
def browser() -> Iterator[Any]:
    with chromium() as opened:
        yield opened


@pytest.fixture
def studio(browser: Any, tmp_path: Path) -> Iterator[Callable[..., Any]]:
    """Starts a server with some meshes; it ends with the test."""
    from morphlet.studio.server import Running

    servers = []

    def start(*meshes: Mesh) -> Any:
        files = [tmp_path / f"mesh-{number}.ply" for number in range(len(meshes))]
        for file, mesh in zip(files, meshes, strict=True):
            write(file, mesh)
        server = Running(files, folder=tmp_path / "sessions")
        servers.append(server)
        return server.__enter__()

    yield start
    for server in servers:
        server.__exit__()


@pytest.fixture
def window(browser: Any) -> Iterator[Callable[..., Window]]:
    """Opens a window; at the end no window may have complained."""
    windows: list[Window] = []

    def look(url: str, **options: Any) -> Window:
        windows.append(Window(browser, url, **options))
        return windows[-1]

    yield look
    complaints = [text for one in windows for text in one.complaints]
    for one in windows:
        one.close()
    assert complaints == []
