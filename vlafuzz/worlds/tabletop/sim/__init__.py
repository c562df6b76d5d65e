"""The ManiSkill evaluator: environment, robots, rendering."""
