"""Exit codes of the contract and the words that stand for them in JSON results."""

from __future__ import annotations

EXIT_INTERNAL = 1
EXIT_USAGE = 2
EXIT_INVALID = 3
EXIT_REFUSED = 4
EXIT_NOTHING = 5
EXIT_CHECK = 6
EXIT_NOT_WRITTEN = 7
EXIT_INTERRUPTED = 130  # whichever signal it was: callers have one code to know

#: Code → status of the result.
STATUS = {
    0: "done",
    EXIT_INTERNAL: "internal-error",
    EXIT_USAGE: "usage",
    EXIT_INVALID: "invalid-input",
    EXIT_REFUSED: "log-refused",
    EXIT_NOTHING: "no-feasible-effect",
    EXIT_CHECK: "check-failed",
    EXIT_NOT_WRITTEN: "not-written",
    EXIT_INTERRUPTED: "interrupted",
}
