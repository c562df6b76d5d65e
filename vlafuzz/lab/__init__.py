"""This room holds what researchers run: comparisons of strategies, and studies. Only its commands import it."""
