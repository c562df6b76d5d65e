"""Scenes derived from those of a run: with other light or camera, or with other instructions."""

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any, NamedTuple, cast

import numpy as np
import yaml

from vlafuzz.errors import UsageError
from vlafuzz.model.scene import Scene
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.space import SearchSpace
from vlafuzz.worlds.tabletop.tasks import load_wordings, say

MUTANTS = 3  # per scene, as in the paper
CONTROL = "control"
_REDRAWS = 100
Says = tuple[str, ...]
"""A prompt: the instruction, and those that replace it as stages are reached."""


class Variant(NamedTuple):
    """A scene derived from the ``origin``-th scene of a run; ``arm`` says how."""

    scene: Scene
    origin: int
    arm: str


def mutants(space: SearchSpace, scenes: Sequence[Scene], seed: int, arm: str) -> list[Variant]:
    """Each scene unmutated as a control, then ``MUTANTS`` distinct mutants of it, in which the space's operators vary.

    Raises:
        UsageError: the ranges leave no room for so many.
    """
    variants: list[Variant] = []
    for origin, scene in enumerate(scenes):
        rng = np.random.default_rng([seed, int(scene.digest, 16)])  # a scene's mutants suit all policies
        variants.append(Variant(scene, origin, CONTROL))
        variants += [Variant(mutant, origin, arm) for mutant in _draws(space, scene, rng)]
    return variants


def _draws(space: SearchSpace, scene: Scene, rng: np.random.Generator) -> list[Scene]:
    values, drawn = space.values(scene), {scene: None}
    for _ in range(_REDRAWS):
        changed = values | {gene.path: gene.draw(rng) for gene in space.genes}
        drawn[space.composer.compose(changed)] = None
        if len(drawn) > MUTANTS:
            return list(drawn)[1:]
    names = ", ".join(sorted(space.operators.varied))
    raise UsageError(f"{names}: the ranges hold no {MUTANTS} mutants of a scene", hint="widen them")


def paraphrases(task: str) -> list[Says]:
    """Ten other wordings of a task, for RQ6."""
    return [(text,) for text in (*load_wordings()[task][1:], _prompts()["paraphrases"][task])]


def two_steps(task: str) -> list[Says]:
    """Both steps of a task in one instruction, and one at a time; none for a task of one step."""
    return [
        tuple([said] if isinstance(said, str) else said)
        for kind in ("two-step", "step-by-step")
        if (said := _prompts()[kind].get(task))
    ]


@cache
def _prompts() -> dict[str, dict[str, Any]]:
    """By kind of prompt, the wordings by task."""
    text = (Path(__file__).parent / "prompts.yaml").read_text(encoding="utf-8")
    return cast(dict[str, dict[str, Any]], yaml.safe_load(text))


def reworded(scenes: Sequence[Scene], prompts: Sequence[Says], catalogue: Catalogue) -> list[Variant]:
    """Every scene with every prompt."""
    return [
        Variant(_say(scene, prompt, catalogue), origin, " / ".join(prompt))
        for origin, scene in enumerate(scenes)
        for prompt in prompts
    ]


def _say(scene: Scene, prompt: Says, catalogue: Catalogue) -> Scene:
    spoken = [catalogue[target.object].spoken for target in scene.targets]
    first, *then = (say(text, spoken) for text in prompt)
    return replace(scene, instruction=first, then=tuple(then))
