"""Run time against error: ``python -m benchmarks`` writes one JSON and one table."""
