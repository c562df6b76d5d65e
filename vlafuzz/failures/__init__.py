"""Failures: what triage makes of them, and the corpora that keep them."""
