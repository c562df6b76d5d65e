"""The capabilities of the tabletop besides its tasks: a catalogue, files of VLATest, stepping by hand."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from vlafuzz.common import assets
from vlafuzz.common.watch import Watch
from vlafuzz.model.conditions import Conditions
from vlafuzz.model.scene import Scene
from vlafuzz.model.scene_lines import SceneFile
from vlafuzz.worlds import known_worlds, world_of
from vlafuzz.worlds.base import Wanted
from vlafuzz.worlds.capabilities import Drawing, Frame, Imported, ListedObject, ListedOperators, Stepped
from vlafuzz.worlds.manipulation.operator_set import load_operators
from vlafuzz.worlds.manipulation.rigs.robots import PANDA, rig
from vlafuzz.worlds.manipulation.space import check_names
from vlafuzz.worlds.tabletop import renderer
from vlafuzz.worlds.tabletop.objects import Pack, load_catalogue, open_packs
from vlafuzz.worlds.tabletop.objects.catalogue import stored_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.objects.packs import packs_of
from vlafuzz.worlds.tabletop.tasks import task as task_named

if TYPE_CHECKING:
    from vlafuzz.worlds.tabletop.lint import TableLinter


class TabletopCapabilities:
    """``Equipped``, ``Catalogued``, ``SceneFormats`` and ``Steppable``."""

    def packages(self) -> dict[str, str]:
        missing = "no scene can be simulated"
        return {"mani_skill": missing, "sapien": missing, "torch": "ManiSkill cannot be loaded"}

    def try_drawing(self) -> Drawing:
        probed = renderer.probe()
        if probed.works:
            software = "llvmpipe" in (probed.device or "")
            slow = "in software: pictures cost more than physics" if software else ""
            return Drawing(probed.name, works=True, follows=slow)
        lost = "policies without camera (expert, pinhole) run; pictures, videos and policies that see do not"
        return Drawing(probed.problem or "", works=False, follows=f"{lost}; hint: {renderer.HINT}")

    def open_packs(self, folders: Sequence[str], watch: Watch) -> tuple[Pack, ...]:
        assets.add_folders(Path(folder) for folder in folders if Path(folder).is_dir())
        packs = tuple(
            pack for name in folders if not _is_robots_only(Path(name)) for pack in open_packs(name)
        )
        for pack in packs:
            for lack in _lacks(pack):
                watch.note(f"note: {pack.name}: {lack}")
        catalogue = load_catalogue(packs=packs)
        names = catalogue.preferred(catalogue.names()) if packs else ()
        for number, name in enumerate(names):
            watch.progress("objects measured", number, len(names))
            catalogue[name]  # once per object, up to some seconds
        return packs

    def listed_objects(self, packs: Sequence[Pack]) -> list[ListedObject]:
        catalogue = load_catalogue(packs=packs)
        return [_listed(catalogue[name]) for name in catalogue.preferred(catalogue.names())]

    def listed_operators(
        self, source: str | None, task: str | None, robot: str | None, packs: Sequence[Pack]
    ) -> ListedOperators:
        setup, catalogue = rig(robot or PANDA.robot), load_catalogue(packs=packs)
        chosen = load_operators(source or setup.operators)
        check_names(
            chosen, {*catalogue, *(name for world in known_worlds().values() for name in world.objects)}
        )
        if task is not None:
            world_of(task).space(Wanted(task=task_named(task).name, robot=setup.robot, packs=packs), chosen)
            chosen = chosen.in_task(task)
        rows = [
            {
                "operator": name,
                "changes": operator.says,
                "range": operator.ranges(),
                "nominal": operator.nominally(),
                "varies": "yes" if name in chosen.varied else "no",
            }
            for name, operator in chosen.operators.items()
        ]
        bounds = f"a target counts as visible with at least {chosen.visible}"
        seen = bounds if chosen.visible else "targets need not be visible"
        apart = f"{chosen.min_distance:g} m between the centres of any two objects"
        title = f"{chosen.source.stem}: {apart}; {seen}"
        return ListedOperators(title=title, rows=rows, differing=sorted(chosen.tasks) if task is None else ())

    def import_scenes(self, path: Path, frame: Frame) -> Imported:
        from vlafuzz.worlds.tabletop.vlatest.read import read_vlatest

        return read_vlatest(path, load_catalogue(), frame=frame)

    def read_scene_file(self, path: Path, frame: Frame) -> SceneFile:
        from vlafuzz.worlds.tabletop.vlatest.read import read_scene_file

        return read_scene_file(path, load_catalogue(), frame)

    def export_scenes(self, out: Path, scenes: Sequence[Scene]) -> Mapping[str, int]:
        from vlafuzz.worlds.tabletop.vlatest.write import write_vlatest

        ours = (scene for scene in scenes if not self.is_foreign(scene))  # the others are written unchanged
        names = (placement.object for scene in ours for placement in scene.placements)
        return write_vlatest(out, scenes, load_catalogue(packs=packs_of(names)))

    def is_foreign(self, scene: Scene) -> bool:
        from vlafuzz.worlds.tabletop.vlatest.original import as_original

        return as_original(scene) is not None

    def linter(self, packs: Sequence[Pack]) -> TableLinter:
        from vlafuzz.worlds.tabletop.lint import TableLinter

        return TableLinter(load_catalogue(packs=packs))

    def stepped(self, runs: Sequence[Conditions], robot: str, size: int, hz: int) -> Stepped:
        from vlafuzz.worlds.tabletop.sim.stepped import SteppedTable

        return SteppedTable(runs[0], stored_catalogue(*runs), robot, size, hz)


def _is_robots_only(folder: Path) -> bool:
    """Whether a folder has robots, and nothing that could be objects."""
    names = {path.name for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else set()
    return "robots" in names and names <= {"robots", "overlays"}


def _lacks(pack: Pack) -> Iterable[str]:
    plain = [name for name, model in pack.objects.items() if model.visual is None]
    if plain:
        some = ", ".join(plain[:3]) + (", …" if len(plain) > 3 else "")
        yield (
            f"{len(plain)} of {len(pack.objects)} objects have no textured mesh ({some}): "
            "they look like their collision mesh, in one colour"
        )
    if pack.left_out:
        yield f"no collision mesh, so left out: {', '.join(pack.left_out)}"


def _listed(model: ObjectModel) -> ListedObject:
    poses = {
        pose.name: min((grasp.width for grasp in pose.grasps), default=None) for pose in model.stable_poses
    }
    return ListedObject(
        name=model.name,
        spoken=model.spoken,
        role=model.role,
        size=tuple(round(float(side), 4) for side in np.ptp(model.vertices, axis=0)),
        mass=model.mass,
        poses=poses,
    )
