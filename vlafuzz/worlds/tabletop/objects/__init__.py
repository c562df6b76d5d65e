"""The objects of a scene: size, mass, stable poses, grasps and looks."""

from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.worlds.tabletop.objects.model import Container, Grasp, ObjectModel, StablePose
from vlafuzz.worlds.tabletop.objects.packs import Pack, find_pack, open_packs

__all__ = [
    "Catalogue",
    "Container",
    "Grasp",
    "ObjectModel",
    "Pack",
    "StablePose",
    "find_pack",
    "load_catalogue",
    "open_packs",
]
