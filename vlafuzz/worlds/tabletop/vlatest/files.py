"""Files of scenes, ours or VLATest's."""

from pathlib import Path

from vlafuzz.model.scene_lines import SceneFile, is_document, read_scenes
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue
from vlafuzz.worlds.tabletop.vlatest.read import Frame, read_vlatest


def read_scene_file(path: Path, catalogue: Catalogue, frame: Frame) -> SceneFile:
    """Read a file of scenes, ours or VLATest's; for ``frame`` see ``read_vlatest``."""
    if not is_document(path):
        return SceneFile(path, tuple(read_scenes(path)))
    imported = read_vlatest(path, catalogue, frame=frame)
    return SceneFile(path, tuple(zip(imported.numbers, imported.scenes, strict=True)), imported.left_out)
