"""The ManiSkill evaluator: environment, robots, rendering."""

from vlafuzz.worlds.tabletop.renderer import keep_to_avx

keep_to_avx()
