"""The independent re-check: its own polynomial, its own arithmetic, its own way to a verdict.

Nothing here reads the code that tuned. The loop is assembled in z from the printed transfer
functions, equation (37), with balls of several hundred bits, in which their cancellation does not
matter; a verdict is a statement about certified roots, and whatever cannot be certified has failed.
"""
