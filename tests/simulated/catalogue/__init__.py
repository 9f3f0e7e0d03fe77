"""Logs that must be refused, doubted or accepted: three for every finding, and good ones.

``cases.cases(seed)`` gives the catalogue of faults, ``good.good_logs(count, seed)`` logs that
nobody may refuse.
"""
