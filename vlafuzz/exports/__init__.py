"""Other tools: gymnasium and LeRobot."""
