"""Baselines: published strategies that are kept to compare against, none of which we recommend.

They find fewer distinct causes than random generation does; docs/results.md has the comparison.
"""
