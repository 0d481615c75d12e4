"""The verb of the window: the studio in the browser."""

from pathlib import Path
from typing import Any

from morphlet.cli.options import DEFAULTS
from morphlet.console import Common, Run, execute
from morphlet.errors import InputError


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

            from morphlet.studio.server import serve

        if common.picture is not None:
            raise InputError("no --picture for studio", "one", "leave it out: the page is the picture")
        serve(mesh, host=host, port=port, say=run.say, ready=webbrowser.open if browser else lambda url: None)
        return {}

    return execute("studio", [*mesh], common, work)
