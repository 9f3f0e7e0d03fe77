"""What a device rests on: the logs it was identified from and the joint covariance."""

from __future__ import annotations

from pydantic import Field, model_validator

from identification.device.friction import UnmodelledForce
from identification.documents.document import Document


class Covariance(Document):
    """Joint covariance of everything identified together, in the units of the device."""

    parameters: tuple[str, ...]
    matrix: tuple[tuple[float, ...], ...]
    degrees_of_freedom: float = Field(gt=0)

    @model_validator(mode="after")
    def _square(self) -> Covariance:
        size = len(self.parameters)
        if len(self.matrix) != size or any(len(row) != size for row in self.matrix):
            raise ValueError(f"matrix must be {size} x {size}, one row for each parameter")
        if any(self.matrix[i][i] < 0 for i in range(size)):
            raise ValueError("matrix has a negative variance")
        return self


class LogRecord(Document):
    """One log the device was identified from, and what was let through.

    ``read_as`` tells how a file that is no plain table in SI units was understood.
    """

    source: str
    digest: str
    samples: int
    method: str
    findings: tuple[str, ...] = ()
    allowed: tuple[str, ...] = ()
    unmodelled_forces: tuple[UnmodelledForce, ...] = ()
    read_as: str = ""
