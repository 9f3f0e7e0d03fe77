"""What people write and read: scene, profile, certificate, perception table; errors."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from identification import Document


class TuneError(Exception):
    """Base of every error this package raises on purpose."""


class LoopError(TuneError):
    """A loop that cannot be built from the numbers given."""


class NoFeasibleEffectError(TuneError):
    """Nothing the scene asks for can be rendered safely. Attributes: reasons, one per effect."""

    def __init__(self, reasons: tuple[str, ...]) -> None:
        self.reasons = reasons
        super().__init__("no feasible effect: " + "; ".join(reasons))


class CheckFailedError(TuneError):
    """A profile the independent check does not pass.

    Attributes:
        failures: sentences, one for each.
        points: of type `WorstPoint`, where it is unstable; empty where no point was found.
    """

    def __init__(self, failures: tuple[str, ...], points: tuple[Document, ...] = ()) -> None:
        self.failures = failures
        self.points = points
        super().__init__("check failed: " + "; ".join(failures))
