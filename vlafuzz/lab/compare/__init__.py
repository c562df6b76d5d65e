"""Comparison of strategies: several runs of each at equal budget, their figures, and statistical tests."""
