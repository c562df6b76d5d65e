"""The tabletop: VLATest's tasks on ManiSkill. It is the default, and its simulator is loaded last."""

from collections.abc import Callable, Collection, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar, Unpack

import numpy as np

from vlafuzz.common import assets
from vlafuzz.common.check import Check
from vlafuzz.common.child import tried
from vlafuzz.common.watch import Watch
from vlafuzz.errors import PrerequisiteError, UsageError
from vlafuzz.model import Conditions, Rejection, Scene, Setting, Solver, Space, Task
from vlafuzz.policies.base import Policy
from vlafuzz.policies.clients.model import Interface
from vlafuzz.policies.mini.policy import Mini
from vlafuzz.worlds.base import Demonstrator, Judge, TryingPolicy
from vlafuzz.worlds.evaluator import Options, SceneEvaluator
from vlafuzz.worlds.manipulation.operator_set import load_operators, stored_operators
from vlafuzz.worlds.manipulation.rigs import PANDA, RIGS, rig
from vlafuzz.worlds.manipulation.space import TableWorld
from vlafuzz.worlds.provenance import versions
from vlafuzz.worlds.tabletop import renderer
from vlafuzz.worlds.tabletop.evaluator import QUALITY, TabletopEvaluator
from vlafuzz.worlds.tabletop.experts.expert import Expert
from vlafuzz.worlds.tabletop.experts.pinhole import Pinhole
from vlafuzz.worlds.tabletop.experts.seeing import SeeingExpert
from vlafuzz.worlds.tabletop.fairness import check_static
from vlafuzz.worlds.tabletop.objects import Pack, load_catalogue, open_packs
from vlafuzz.worlds.tabletop.objects.catalogue import Catalogue, packs_json, stored_catalogue
from vlafuzz.worlds.tabletop.objects.model import ObjectModel
from vlafuzz.worlds.tabletop.objects.packs import packs_of
from vlafuzz.worlds.tabletop.space import OperatorSet, SearchSpace
from vlafuzz.worlds.tabletop.tasks import TASKS, task as task_named
from vlafuzz.worlds.tabletop.vlatest import read_vlatest

LOADING = "import mani_skill.envs"  # with all that it needs, such as sapien and torch


class Tabletop(TableWorld):
    """The world of VLATest's tasks. It alone has objects of packs, and reads scene files of another program."""

    usual = True
    tasks, robots = tuple(TASKS), tuple(RIGS)
    settings: Sequence[Setting[Any]] = (*TableWorld.settings, QUALITY)
    policies: ClassVar[Mapping[str, Callable[..., Policy]]] = {
        "mini": Mini,
        "pinhole": Pinhole,
        "expert": Expert,
        "seeing": SeeingExpert,
    }

    @property
    def simulator(self) -> str:
        installed = versions()
        return "/".join(f"{package} {installed.get(package)}" for package in ("vlafuzz", "mani_skill", "sapien"))

    def renderer(self) -> str:
        return renderer.probe_once().name

    def has(self, task: str) -> bool:
        return task in TASKS

    def task(self, name: str) -> Task:
        return task_named(name)

    def default_policy(self, robot: str) -> str:
        """``mini`` where its robot's pictures can be rendered, else ``pinhole``, which needs physics only."""
        return "mini" if robot == PANDA.robot and renderer.probe_once().works else "pinhole"

    def simulated(self) -> type[TabletopEvaluator]:
        """The class that runs a policy in scenes. This loads the simulator, which takes seconds."""
        from vlafuzz.worlds.tabletop.sim.env import ManiSkillEvaluator

        return ManiSkillEvaluator

    def preload(self) -> None:
        self.simulated()

    def conditions_of(self, scene: Scene) -> dict[str, str]:
        """The packs that its objects are from."""
        return {"packs": packs_json(packs_of(placement.object for placement in scene.placements))}

    def check_pictures(self) -> None:
        if not (probed := renderer.probe_once()).works:
            raise PrerequisiteError(f"pictures need a renderer: {probed}", hint="`vlafuzz doctor` says what to install")

    def space_of(self, task: str, robot: str, operators: OperatorSet, packs: Sequence[Any]) -> SearchSpace:
        setup = rig(robot)
        if setup.urdf:
            assets.need(f"robots/{setup.urdf}", f"robot={setup.robot}")
        return SearchSpace(operators, load_catalogue(packs=packs), task, robot)

    def stored_space(self, source: Path, conditions: Conditions, vary: Collection[str] | None = None) -> SearchSpace:
        operators = stored_operators(source, conditions, vary)
        return SearchSpace(operators, stored_catalogue(conditions), conditions.task, conditions.robot)

    def evaluator(
        self, conditions: Conditions, policy: Policy, space: Space | None, **options: Unpack[Options]
    ) -> SceneEvaluator:
        return self.simulated()(conditions, policy, self.catalogue(conditions, space), **options)

    @staticmethod
    def catalogue(conditions: Conditions, space: Space | None) -> Catalogue:
        """The objects of a run."""
        if conditions.world.get("placement"):
            problem = "objects are no longer dropped as in VLATest"
            raise UsageError(f"placement {conditions.world['placement']}: {problem}", hint="run the scenes anew")
        return space.catalogue if isinstance(space, SearchSpace) else stored_catalogue(conditions)

    def solvers(self) -> Mapping[Solver, TryingPolicy]:
        return {"expert": Expert(), "seeing": SeeingExpert()}

    def demonstrator(self, interface: Interface) -> Demonstrator:
        from vlafuzz.worlds.tabletop.experts.expert import TabletopDemonstrator

        return TabletopDemonstrator(interface)

    def machine(self) -> Iterator[Check]:
        """The simulator's packages, and what draws pictures; this takes some seconds, mostly for loading them."""
        found = ", ".join(f"{package} {version}" for package, version in versions().items() if package != "vlafuzz")
        _, problem = tried(LOADING, 180.0)
        if problem:
            lost = "no scene can be simulated; hint: run scripts/setup"
            yield Check("simulator", f"{found}: {problem}", "refuse", lost)
        else:
            yield Check("simulator", found)
        probed = renderer.probe()
        if probed.works:
            software = "llvmpipe" in (probed.device or "")
            yield Check("renderer", probed.name, "ok", "in software: pictures cost more than physics" * software)
        else:
            lost = "policies without camera (expert, pinhole) run; pictures, videos and policies that see do not"
            yield Check("renderer", probed.problem or "", "warn", f"{lost}; hint: {renderer.HINT}")

    def open_packs(self, folders: Sequence[str], watch: Watch) -> tuple[Pack, ...]:
        """The packs in these folders, measured."""
        assets.add_folders(Path(folder) for folder in folders if Path(folder).is_dir())
        packs = tuple(pack for name in folders if not _is_robots_only(Path(name)) for pack in open_packs(name))
        catalogue = load_catalogue(packs=packs)
        names = catalogue.preferred(catalogue.names()) if packs else ()
        for number, name in enumerate(names):
            watch.progress("objects measured", number, len(names))
            catalogue[name]  # once per object, up to some seconds
        return packs

    def listed_objects(self, packs: Sequence[Pack]) -> list[dict[str, Any]]:
        catalogue = load_catalogue(packs=packs)
        return [_listed(catalogue[name]) for name in catalogue.preferred(catalogue.names())]

    def judge(self, packs: Sequence[Pack], *, settle: bool) -> Judge:
        catalogue, usual = load_catalogue(packs=packs), load_operators()

        def rejection(scene: Scene) -> Rejection | None:
            found = check_static(scene, catalogue, usual.min_distance, usual.visible)
            return found if found or not settle else self.simulated().settled(scene, catalogue)

        return rejection

    def imported(self, path: Path) -> Sequence[Scene]:
        """The scenes of a file of VLATest."""
        return read_vlatest(path)


def _is_robots_only(folder: Path) -> bool:
    """Whether a folder has robots, and nothing that could be objects."""
    names = {path.name for path in folder.iterdir() if path.is_dir()} if folder.is_dir() else set()
    return "robots" in names and names <= {"robots", "overlays"}


def _listed(model: ObjectModel) -> dict[str, Any]:
    return {
        "object": model.name,
        "spoken": model.spoken,
        "role": model.role,
        "size": tuple(round(float(side), 4) for side in np.ptp(model.vertices, axis=0)),
        "mass": model.mass,
        "rest poses": {pose.name: min((one.width for one in pose.grasps), default=None) for pose in model.stable_poses},
    }


WORLD = Tabletop()
