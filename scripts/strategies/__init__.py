"""The parts of bench_strategies.py: a file a benchmark, and what they share."""
