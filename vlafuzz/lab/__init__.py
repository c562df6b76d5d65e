"""What researchers run: comparisons of strategies, studies, coverage. Nothing imports it but its commands."""
