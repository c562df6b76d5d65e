"""Other tools: gymnasium, LeRobot, vla-eval."""
