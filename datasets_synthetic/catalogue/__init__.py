"""Logs that must be refused, doubted or accepted: three for every finding, and good ones.

``cases(seed)`` gives the catalogue of faults, ``good_logs(count, seed)`` logs that nobody may
refuse.
"""

from __future__ import annotations

from datasets_synthetic.catalogue.cases import LEVELS, Case, cases
from datasets_synthetic.catalogue.good import GoodLog, good_logs
from datasets_synthetic.catalogue.raw import RawLog

__all__ = ["LEVELS", "Case", "GoodLog", "RawLog", "cases", "good_logs"]
