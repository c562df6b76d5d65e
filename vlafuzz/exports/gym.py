"""A corpus as a gymnasium environment: its failing scenes one after the other.

``gymnasium.make("vlafuzz.exports.gym:vlafuzz/Corpus-v0", corpus="mini-pick-up")``; of several side by side the n-th of
eight has ``first=n, every=8``.
"""

from pathlib import Path
from typing import Any

import gymnasium
import numpy as np
from gymnasium import spaces
from numpy.typing import NDArray

from vlafuzz.errors import UsageError
from vlafuzz.failures.corpus.corpus import Case
from vlafuzz.failures.corpus.folder import read_corpus
from vlafuzz.policies.base import ActionSpec, CameraRequest, PolicySpec
from vlafuzz.policies.controls import Frozen
from vlafuzz.rollouts.setup import make_evaluator
from vlafuzz.worlds import world_of
from vlafuzz.worlds.evaluator import SceneEvaluator

HZ = 5
ID = "vlafuzz/Corpus-v0"
MOST = (0.25, 0.25, 0.25, np.pi, np.pi, np.pi)  # metres and radians per step: more than the robot can do
# Bounds of the hand pose and the opening
STATE = ((-2, 2), (-2, 2), (-1, 2), *[(-3.15, 3.15)] * 3, (-0.1, 1.1))
Seen = dict[str, Any]


class CorpusEnv(gymnasium.Env[Seen, NDArray[np.float64]]):
    """Every reset builds the next failing scene of a corpus, or a requested one.

    Observations: ``image`` (size, size, 3) uint8 of the third-person camera, absent for ``size`` 0; ``state`` (7,)
    float32: hand's position (metres), rotation vector (radians), opening in [0, 1]; ``instruction``. Actions: (7,): dx
    dy dz (metres) and rotation vector (radians) relative to the hand, gripper (1 open,
    -1 closed). Five steps per second, for 16 s. The reward is the gain in progress; success terminates.

    Args:
        corpus: folder that `vlafuzz export --minimal` wrote, or the name of a shipped one.
        size: of an image, pixels; 0 for no images, which needs no renderer.
        first: number of the first case; every ``every``-th case follows, in a circle.

    Raises:
        CorpusError: the folder is not a corpus, or is damaged.
        UsageError: an object pack of the corpus is missing.
        PrerequisiteError: images are requested, and rendering does not work here.
    """

    metadata = {"render_modes": ["rgb_array"], "render_fps": HZ}  # noqa: RUF012 - gymnasium's convention
    render_mode = "rgb_array"

    def __init__(self, corpus: Path | str, size: int = 128, *, first: int = 0, every: int = 1) -> None:
        exported = read_corpus(Path(corpus))
        self.cases, self._runs = exported.cases, exported.runs
        self._draws = bool(size)
        world = world_of(exported.task)
        if not world.usual:
            problem = f"{exported.task}: its world cannot be driven step by step"
            raise UsageError(problem, hint="`vlafuzz replay` and `vlafuzz regress` run its scenes")
        if size:
            world.check_pictures()
        self._policy = Frozen()  # only its spec is used
        cameras = (CameraRequest("image", size, size),) if size else ()
        action = ActionSpec(relative_to="current", hz=HZ)
        self._policy.spec = PolicySpec("gymnasium", cameras=cameras, action=action, state=True)
        self._evaluators: dict[int, SceneEvaluator] = {}  # by run
        instructions = [case.scene.instruction for case in self.cases]
        seen: dict[str, spaces.Space[Any]] = {
            "state": spaces.Box(*np.array(STATE, dtype=np.float32).T),
            "instruction": spaces.Text(max(map(len, instructions)), charset=frozenset("".join(instructions))),
        }
        if self._draws:
            seen["image"] = spaces.Box(0, 255, (size, size, 3), np.uint8)
        self.observation_space = spaces.Dict(seen)
        reach = np.array([*MOST, 1.0])
        self.action_space = spaces.Box(-reach, reach, (7,), np.float64)
        self._next = self._first = first % len(self.cases)
        self._every = every

    def reset(self, *, seed: int | None = None, options: dict[str, Any] | None = None) -> tuple[Seen, dict[str, Any]]:
        """Build case ``options["case"]``, or the next one; with a seed, the first one."""
        super().reset(seed=seed)
        number = (options or {}).get("case", self._next if seed is None else self._first)
        if not (isinstance(number, int) and 0 <= number < len(self.cases)):
            raise UsageError(f"options['case']: {number!r}", hint=f"0 to {len(self.cases) - 1}")
        self._next = (number + self._every) % len(self.cases)
        self._case: Case = self.cases[number]
        run = self._case.run
        if run not in self._evaluators:
            self.close()
            self._evaluators[run] = make_evaluator(self._runs[run], self._policy, checked=False)
        self._episode = self._evaluators[run].begin(self._case.scene, 0)
        about = {"case": number, "digest": self._case.scene.digest, "signature": self._case.signature}
        return self._observation(), about | {"lost_stage": self._case.lost_stage}

    def step(self, action: NDArray[np.float64]) -> tuple[Seen, float, bool, bool, dict[str, Any]]:
        metric = np.asarray(action, dtype=np.float64)
        if metric.shape != (7,) or not np.all(np.isfinite(metric)):
            raise UsageError(f"action: {action!r}", hint="expected 7 finite numbers")
        episode, before = self._episode, self._episode.monitor.progress
        episode.advance(metric)
        progress, done = episode.monitor.progress, episode.success
        info = {"progress": progress, "reached": tuple(episode.monitor.reached), "success": done}
        return self._observation(), progress - before, done, episode.over and not done, info

    def render(self) -> Any:
        """The current image of the third-person camera: (size, size, 3) uint8."""
        return self._episode.picture("image") if self._draws else None

    def close(self) -> None:
        while self._evaluators:
            self._evaluators.popitem()[1].close()

    def _observation(self) -> Seen:
        observed = self._episode.observe()
        seen: Seen = {"state": observed.state, "instruction": self._case.scene.instruction}
        return seen | ({"image": observed.images["image"]} if self._draws else {})


gymnasium.register(ID, entry_point="vlafuzz.exports.gym:CorpusEnv")
