"""What any program may need: text, files, reading within bounds, statistics, progress, time limits."""
