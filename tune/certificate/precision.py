"""The precision of every ball."""

from __future__ import annotations

from flint import ctx

#: Bits of every ball. The printed plant loses 2·log2(1/δ) of them: 80 at δ = 1e-12.
BITS = 400


class _precision:  # noqa: N801 - reads as a phrase: with precision()
    """Balls of BITS bits inside, whatever the caller had outside."""

    def __enter__(self) -> None:
        self._outside = ctx.prec
        ctx.prec = BITS

    def __exit__(self, *_: object) -> None:
        ctx.prec = self._outside


precision = _precision
