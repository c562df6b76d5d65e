"""The one way to an outcome: policies by name, and what makes evaluators of worlds."""
