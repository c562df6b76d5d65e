"""The objects of a scene: what they measure and weigh, how they rest, where to grasp them, how they look."""

from vlafuzz.objects.catalogue import Catalogue, load_catalogue
from vlafuzz.objects.model import Container, Grasp, ObjectModel, RestPose

__all__ = ["Catalogue", "Container", "Grasp", "ObjectModel", "RestPose", "load_catalogue"]
