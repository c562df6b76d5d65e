"""The objects of a scene: size, mass, stable poses, grasps and looks."""

from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel, StablePose
from vlafuzz.worlds.tabletop.objects.packs import Pack, open_packs

__all__ = ["Catalogue", "ObjectModel", "Pack", "StablePose", "load_catalogue", "open_packs"]
