"""A window on one folder: ``haptune open``."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from typer import Argument, Option

from identification import UsageError
from tune.cli.session import Session, command


@command()
def open_command(
    session: Session,
    folder: Annotated[Path, Argument(help="Its files are shown; default: this one.")] = Path(),
    port: Annotated[int, Option(min=0, max=65535, help="0 takes any that is free.")] = 0,
    no_browser: Annotated[bool, Option("--no-browser", help="Only print the address.")] = False,
) -> None:
    """Serve a page on this machine alone, until Ctrl-C or the last closed tab."""
    import webbrowser

    if not folder.is_dir():
        raise UsageError("FOLDER", f"there is no folder {folder}", "Give one that exists")
    try:
        from tune.page.server import serve
    except ImportError as error:
        missing = f"needs {error.name}, which is not installed"
        raise UsageError("haptune open", missing, "pip install 'haptune[page]'") from None

    def tell(address: str) -> None:
        session.tell(f"{folder.resolve()}: {address}\nCtrl-C or the last closed tab ends it.")
        if not no_browser:
            webbrowser.open(address)

    try:
        serve(folder, port, tell)
    except OSError as error:
        raise UsageError("--port", f"{port}: {error.strerror}", "Give another, or 0") from None
