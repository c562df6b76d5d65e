"""What worlds share whose scenes are things on a table: operators, robots, cameras, jitter."""
