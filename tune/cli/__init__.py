"""The command line: one file a command, contracts kept in `tune.cli.session`."""

from __future__ import annotations


def main() -> None:
    """Entry point of the command ``haptune``."""
    _silence_libraries()
    from tune.cli.app import run

    run()


def _silence_libraries() -> None:
    """Keep what libraries say to programmers off standard error, unless Python's -W asks for it."""
    import logging
    import sys
    import warnings

    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    logging.getLogger().addHandler(logging.NullHandler())
