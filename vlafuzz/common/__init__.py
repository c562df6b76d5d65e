"""These modules know nothing of policies: text, files, reading within bounds, statistics, time limits."""
