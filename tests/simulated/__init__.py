"""What tests and benchmarks simulate: families, fleets and faults of logs, experiments on benches.

It plays the simulator of ``datasets_synthetic`` and imports nothing else of the tests, so that it
shares no algebra with what it is used to judge.
"""
