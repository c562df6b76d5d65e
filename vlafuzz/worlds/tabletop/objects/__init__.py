"""The objects of a scene: size, mass, stable poses, grasps and looks."""

from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue as Catalogue, load_catalogue as load_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel as ObjectModel, StablePose as StablePose
from vlafuzz.worlds.tabletop.objects.packs import Pack as Pack, open_packs as open_packs
