"""Whether a person could see the targets in the policy's first picture."""

import math
from collections.abc import Iterator

import numpy as np

from vlafuzz.model.scene import Scene
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.rigs.backdrops import PAINTS
from vlafuzz.worlds.tabletop.fairness.picture import Picture
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel

# Shares of what is seen of a target: less is never enough to find it (a sponge's edge is), the other always.
LEAST, MOST = 0.04, 0.5


def unseen(scene: Scene, catalogue: Catalogue, bounds: Visible, *, outlines: bool = False) -> str | None:
    """Why a person could not see a target of a scene that passes the other checks; None if they all are seen.

    ``outlines``: whether the policy gets outlines in flat colours instead of pictures.
    """
    return next(_problems(scene, catalogue, bounds, outlines=outlines), None)


def _problems(scene: Scene, catalogue: Catalogue, bounds: Visible, *, outlines: bool) -> Iterator[str]:
    picture = Picture(scene, catalogue)
    for index, placement in enumerate(scene.targets):
        model, seen = catalogue[placement.object], picture.hidden(index)
        if seen.inside < bounds.inside:
            least = f"at least {bounds.inside:.0%} is required"
            yield f"{model.spoken}: only {seen.inside:.0%} of it is in the picture; {least}"
        if seen.unhidden < bounds.unhidden:
            most = f"at most {1 - bounds.unhidden:.0%} may be hidden"
            yield f"{model.spoken}: {seen.by} hides {1 - seen.unhidden:.0%} of it; {most}"
        if seen.area < bounds.area:
            least = f"at least {bounds.area:.3%} is required"
            yield f"{model.spoken}: it covers only {seen.area:.3%} of the picture; {least}"
        if outlines:
            apart, around, needed = _flat(scene, model), "the table", bounds.apart_in_outlines
        else:
            share = min(max(bounds.area / max(seen.area, bounds.area), LEAST), MOST)
            needed = max(bounds.apart, scene.noise.grain)
            apart, around = picture.apart(index, share)
        if apart < needed:
            difference = f"only {math.floor(apart)}/255 apart from {around}"
            light = f"under light × {scene.light.intensity:.3g}"
            yield f"{model.spoken}: {difference} {light}; at least {needed:g}/255 is required"


def _flat(scene: Scene, model: ObjectModel) -> float:
    """The difference between an object's colour and the table's in outlines."""
    both = np.array([model.colour, PAINTS[scene.backdrop.colour]]) * scene.light.intensity
    thing, table = np.round(np.minimum(both, 1.0) * 255)
    return float(np.abs(thing - table).max())
