"""The independent re-check: its own assemblies, its own arithmetic, its own way to a verdict.

Nothing here reads the code that tuned. Three assemblies check each other: the loop in z from the
printed transfer functions or the exponential of a matrix, in balls of several hundred bits, for
single points; the frequency response folded from all its aliases, in first-order forms with bounds,
for whole boxes; and many points at once in doubles, to search with. Only the first two decide, and
whatever cannot be certified has failed.
"""
