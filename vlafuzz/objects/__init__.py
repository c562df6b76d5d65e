"""The objects of a scene: what they measure and weigh, how they rest, where to grasp them, how they look."""

from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.objects.model import Container, Grasp, ObjectModel, RestPose
from vlafuzz.objects.packs import Pack, find_pack, open_packs

__all__ = [
    "Catalogue",
    "Container",
    "Grasp",
    "ObjectModel",
    "Pack",
    "RestPose",
    "find_pack",
    "load_catalogue",
    "open_packs",
]
