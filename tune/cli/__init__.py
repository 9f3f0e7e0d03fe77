"""The command line: commands by what they are about, contracts kept in `tune.cli.session`.

Nothing is imported before `main` runs, so that a signal finds it ready from its first line on.
"""

from __future__ import annotations

#: New objects until unreachable circles are looked for among them, and how often among older ones.
_COLLECTED_AFTER = 200_000, 50, 100


def main() -> None:
    """Entry point of the command ``haptune``."""
    try:
        from tune.cli.process import unwind_on_signals, was_interrupted

        try:
            unwind_on_signals()
            _run()
        except SystemExit:
            raise
        except BaseException:
            if not was_interrupted():
                raise
            _end_early()
    except KeyboardInterrupt:  # before signals were taken over
        _end_early()


def _run() -> None:
    import sys

    from tune.cli.process import prepare_streams

    prepare_streams()
    from haptune import own_tune

    try:
        own_tune()
    except ImportError as error:  # another project's package of this name stands over ours
        sys.stderr.write(f"haptune: {error}\n")
        sys.exit(1)
    _prepare_libraries()
    from tune.cli.app import run_app

    run_app()


def _end_early() -> None:
    """End where a signal came before a command began, or in the moment after it ended."""
    import sys

    from tune.cli.process import prepare_streams
    from tune.cli.session import finish_interrupted

    prepare_streams()
    sys.exit(finish_interrupted())


def _prepare_libraries() -> None:
    """Keep what libraries say to programmers off standard error, unless Python's -W asks for it.

    Plugins that other packages bring for pydantic change nothing here and take time to look for.
    Threads of linear algebra wait for each other longer than the small matrices here take, and a
    log of a million rows is no faster by them. Few objects here refer to each other in circles:
    they are looked for rarely, and memory is freed by the system when a command ends, not object by
    object: together that is a twentieth of the time of `tune`.
    """
    import atexit
    import gc
    import logging
    import os
    import sys
    import warnings

    os.environ.setdefault("PYDANTIC_DISABLE_PLUGINS", "__all__")
    os.environ.setdefault("OMP_NUM_THREADS", "1")

    if not sys.warnoptions:
        warnings.simplefilter("ignore")
    logging.getLogger().addHandler(logging.NullHandler())
    gc.set_threshold(*_COLLECTED_AFTER)
    atexit.register(gc.freeze)
