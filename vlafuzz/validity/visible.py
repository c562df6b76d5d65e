"""Whether a person could see the targets in the policy's first picture."""

import math
from collections.abc import Iterator
from typing import Annotated

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from vlafuzz.objects.catalogue import Catalogue
from vlafuzz.objects.model import ObjectModel
from vlafuzz.rigs.backdrops import PAINTS
from vlafuzz.scene import Scene
from vlafuzz.validity.picture import Picture

# Shares of what is seen of a target: less is never enough to find it (a sponge's edge is), the other always.
LEAST, MOST = 0.04, 0.5
Share = Annotated[float, Field(ge=0, le=1)]
Levels = Annotated[float, Field(ge=0, le=255)]


class Visible(BaseModel):
    """Bounds within which a target counts as visible.

    Attributes:
        inside: least share of its outline inside the picture.
        unhidden: least share of that outline that neither robot nor objects hide.
        area: least share of the picture that is seen of it, and that is apart.
        apart: least difference from its surroundings, of 255 grey levels.
        apart_in_outlines: the same for policies that get outlines in flat colours instead of pictures.
    """

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True)
    inside: Share
    unhidden: Share
    area: Share
    apart: Levels
    apart_in_outlines: Levels

    def __str__(self) -> str:
        """The bounds in words, without those for outlines."""
        outline = f"{self.inside:.0%} of its outline in the picture, {self.unhidden:.0%} of that not hidden"
        return f"{outline}, {self.area:.2%} of the picture and {self.apart:g}/255 apart from its surroundings"


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
