"""The benchmarks of bench_strategies.py, and their results."""
