"""Strategies compared: several runs of each at equal budget, their figures, and whether these differ."""
