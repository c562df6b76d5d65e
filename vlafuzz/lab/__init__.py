"""What researchers run: comparisons of strategies, studies. Nothing imports it but its commands."""
