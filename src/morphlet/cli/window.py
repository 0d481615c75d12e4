"""The verb of the window: the studio in the browser."""

from pathlib import Path
from typing import Any

from morphlet.cli.options import DEFAULTS
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError, MissingExtra


def studio(*mesh: Path, host: str = "127.0.0.1", port: int = 0, browser: bool = True, common: Common = DEFAULTS) -> int:
    """Edit, match and morph meshes in the browser.

    Parameters
    ----------
    mesh
        Source and target, as many as there are; others can be opened in the page.
    host
        Where to listen. Any address but this machine's own can be reached from others.
    port
        Any free one if left out.
    browser
        Open the page in the browser.
    """

    def work(run: Run) -> dict[str, Any]:
        with run.uncounted():
            import webbrowser

            try:
                from morphlet.studio.server import serve
            except ModuleNotFoundError as error:
                needed = "starlette, uvicorn and websockets for the studio"
                raise MissingExtra(needed, str(error), "pip install morphlet[studio]") from error

        if common.picture is not None:
            raise InputError("no --picture for studio", "one", "leave it out: the page is the picture")
        serve(mesh, host=host, port=port, say=run.say, ready=webbrowser.open if browser else lambda url: None)
        return {}

    return execute("studio", [*mesh], common, work)
