"""The command line: one file a command, contracts kept in `tune.cli.session`."""

from __future__ import annotations


def main() -> None:
    """Entry point of the command ``haptune``."""
    from tune.cli.app import run

    run()
