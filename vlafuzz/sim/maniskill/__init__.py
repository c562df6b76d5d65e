"""The ManiSkill evaluator: environment, robots, rendering."""

from vlafuzz.renderer import keep_to_avx

keep_to_avx()
