"""Comparisons of strategies: several runs of each at equal budget, their causes, and statistical tests."""
