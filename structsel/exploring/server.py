"""The local server of the explorer; it answers this computer only."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from structsel.errors import DataError, StructselError
from structsel.exploring.exploration import Exploration
from structsel.exploring.view import View
from structsel.files import path_text

HOST = "localhost"


def require_bokeh() -> None:
    """Refuse to go on without Bokeh.

    Raises
    ------
    StructselError
        It is not installed.
    """
    try:
        import bokeh  # noqa: F401
    except ImportError as error:
        raise StructselError(
            "structsel explore needs the package bokeh, which is not installed.\n"
            'Install it with: pip install "structsel[explore]"'
        ) from error


def make_server(
    exploration: Exploration, view: View, source: Mapping[str, Any], folder: Path, port: int = 0
) -> tuple[Any, str]:
    """Server of the page, not yet running, and the address of the page.

    Parameters
    ----------
    exploration : Exploration
    view : View
        Shown first.
    source : mapping
        Where model and recordings are from; written with every saved view.
    folder : Path
        Of the views that are saved.
    port : int
        0 for one that is free.

    Raises
    ------
    DataError
        The port is in use.
    """
    from bokeh.application import Application
    from bokeh.application.handlers.function import FunctionHandler
    from bokeh.server.server import Server

    from structsel.exploring.browser_explorer import BrowserExplorer
    from structsel.exploring.saving import save_view

    def save(shown: View, name: str) -> str:
        paths = save_view(exploration, shown, source, folder, name)
        return f"Saved in {path_text(folder)}: {', '.join(path.name for path in paths)}."

    def open_page(document: Any) -> None:
        BrowserExplorer(exploration, view, save).add_to(document)

    try:
        # Bokeh accepts web sockets from the page at localhost:port only.
        server = Server(
            {"/": Application(FunctionHandler(open_page))}, port=port, address=HOST, keep_alive_milliseconds=0
        )
    except OSError as error:
        raise DataError(
            f"port {port} cannot be used: {error}.", remedy="Use port 0.", cli_remedy="Leave --port out."
        ) from error
    return server, f"http://{HOST}:{server.port}/"


def serve(server: Any, started: Callable[[], None]) -> None:
    """Run a server until Ctrl-C."""
    server.start()
    server.io_loop.add_callback(started)
    server.run_until_shutdown()
