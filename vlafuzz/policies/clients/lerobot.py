"""LeRobot policies from a folder, which run in this process on the user's own installation of lerobot."""

import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, redirect_stdout
from copy import copy
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from pydantic import Field

from vlafuzz.common.arrays import Array
from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.clients.conventions import STATES
from vlafuzz.policies.clients.model import Model
from vlafuzz.policies.clients.options import CommonOptions, ProfiledOptions
from vlafuzz.policies.clients.servers import Address, needed
from vlafuzz.policies.clients.wire import numbers, read, short
from vlafuzz.policies.harness import WIDTH, BlamedOn, answered, check_chunks

INSTALL = "pip install lerobot, into the environment of vlafuzz"
PICTURES = "observation.images."
EMPTY = "empty_camera"  # of SmolVLA: a placeholder that needs no picture
SAVED = ("pretrained_model", "checkpoints/last/pretrained_model")  # where lerobot's trainer puts a policy
REMEMBERED = ("_queues", "_action_queue", "temporal_ensembler")  # rollout state of policies in lerobot 0.4


class LeRobotOptions(ProfiledOptions):
    """The user's options for the policy; its own config declares its pictures and dimensions.

    ``image_key``: which picture is the third-person view; a single one needs no name. ``device``: of torch.
    """

    protocol: ClassVar[str] = "lerobot"

    state_key: Literal["observation.state"] = "observation.state"
    instruction_key: Literal["task"] = "task"
    device: str | None = Field(default=None, pattern=r"^(cpu|mps|cuda(:\d+)?)$")


class LeRobot:
    """A policy from a folder, as lerobot saves it, run in this process: ?device=cuda.

    It needs lerobot, which the user installs beside vlafuzz. One model serves all workers. Noise is seeded by the
    rollout's seed and step, one observation at a time: in a batch it would depend on the other ones.
    """

    form: ClassVar[str] = "lerobot:FOLDER"
    schemes: ClassVar[Sequence[str]] = ()  # a folder instead of a server
    options: ClassVar[type[CommonOptions]] = LeRobotOptions
    shared: ClassVar[bool] = True

    def __init__(self, address: Address) -> None:
        folder = Path(address.url).expanduser()
        if not (folder / "config.json").is_file():
            inner = [folder / name for name in SAVED if (folder / name / "config.json").is_file()]
            hint = f"lerobot:{inner[0]}" if inner else "name the folder that lerobot saved"
            missing = "no config.json there" if folder.is_dir() else "no such folder"
            raise UsageError(f"{address.name}: {missing}", hint)
        with needed(address.name, hint=INSTALL), _loading(address.name):
            self._policy, self._before, self._after = _load(folder, address.options.device)
        self._name, self._stepwise = address.name, is_stepwise(self._policy.config)
        self._model = Model(address.name, fitted(address.name, address.options, self._policy.config))
        self.spec = self._model.spec
        self._live: dict[str, tuple[EpisodeStart, dict[str, Any]]] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """Begin these rollouts, each with its own memory."""
        for start in episodes:
            self._policy.reset()
            state = vars(self._policy)
            self._live[start.episode] = start, {key: copy(state[key]) for key in REMEMBERED if key in state}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """Answer one observation after the other; see ``answered``."""
        answers: list[ActionChunk | PolicyError] = []
        for seen in observations:
            try:
                with BlamedOn(self._name):
                    answers += check_chunks([ActionChunk(self._act(seen))], 1, self._name)
            except PolicyError as error:
                answers.append(error)
        return answered(answers)

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        for start in episodes:
            self._live.pop(start.episode, None)

    def close(self) -> None:
        self._live.clear()

    def _act(self, seen: Observation) -> Array:
        import torch
        from lerobot.policies.utils import prepare_observation_for_inference

        if seen.episode not in self._live:
            raise PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        start, memory = self._live[seen.episode]
        device, message = torch.device(self._policy.config.device), self._model.message(seen)
        task = message.pop("task")
        vars(self._policy).update(memory)
        seed = np.random.SeedSequence([start.seed, seen.step]).generate_state(1)[0]
        with torch.no_grad(), torch.random.fork_rng([device] if device.type == "cuda" else []):
            torch.manual_seed(int(seed))
            message = {key: np.array(value) for key, value in message.items()}  # lerobot keeps them
            batch = self._before(prepare_observation_for_inference(message, device, task=task))
            choose = self._policy.select_action if self._stepwise else self._policy.predict_action_chunk
            actions = self._after(choose(batch))
        memory.update({key: vars(self._policy)[key] for key in memory})
        with read(self._name, "bad_action"):
            return self._model.checked(numbers(actions.reshape(-1, actions.shape[-1]).cpu().numpy()))


def is_stepwise(config: Any) -> bool:
    """Whether a policy must see every step, since it keeps a history; ``config``: its ``PreTrainedConfig``."""
    return config.n_obs_steps > 1 or getattr(config, "temporal_ensemble_coeff", None) is not None


def fitted(name: str, options: LeRobotOptions, config: Any) -> LeRobotOptions:
    """The options, completed by what the policy declares; UsageError when they contradict it.

    ``config``: its ``PreTrainedConfig``. On a CPU it is deterministic.
    """
    if config.env_state_feature is not None:
        message = f"{name}: the policy wants the state of its environment"
        raise UsageError(message, hint="name one that sees pictures only")
    if config.action_feature is None:
        raise UsageError(f"{name}: the policy has no actions", hint="name the folder of a policy")
    pictures, layout = _pictures(name, options, config), options.layout
    state = int(config.robot_state_feature.shape[0]) if config.robot_state_feature else 0
    width = len(STATES[layout]) if layout else 0
    if state != width:
        message = f"{name}: the policy takes {state} numbers of state, state={layout or 0} has {width}"
        raise UsageError(message, hint="name their layout: state=…")
    if (actions := int(config.action_feature.shape[0])) != WIDTH:
        message = f"{name}: its actions have {actions} numbers, moves of a hand have {WIDTH}"
        raise UsageError(message, hint="joints and poses cannot be executed")
    if is_stepwise(config) and options.execute not in (None, 1):
        raise UsageError(f"{name}: {config.type} remembers past steps, so it sees each", hint="leave execute")
    execute = 1 if is_stepwise(config) else options.execute or int(getattr(config, "n_action_steps", 1))
    same = options.deterministic or str(config.device) == "cpu"
    return options.model_copy(update=pictures | {"execute": execute, "deterministic": same})


def _pictures(name: str, options: LeRobotOptions, config: Any) -> dict[str, Any]:
    """The options of the third-person and of the wrist picture, in full."""
    # Shapes are (3, height, width).
    sizes = {key: (int(part.shape[2]), int(part.shape[1])) for key, part in config.image_features.items()}
    known = {key.removeprefix(PICTURES): key for key in sizes if EMPTY not in key}
    if len(known) == 1 and not options.wrist and "image_key" not in options.model_fields_set:
        (only,) = known.values()
        return {"image_key": only, "camera": sizes[only], "wrist": False}
    named = {} if options.camera == (0, 0) else {("image_key", "camera"): options.image_key}
    named |= {("wrist_key", "wrist_camera"): options.wrist_key} if options.wrist else {}
    if {key.removeprefix(PICTURES) for key in named.values()} != set(known):
        takes, ours = ", ".join(known) or "none", ", ".join(named.values()) or "none"
        message = f"{name}: the policy takes the pictures {takes}, the options name {ours}"
        raise UsageError(message, hint="say which is which: image_key=…&wrist=1&wrist_key=…")
    changes: dict[str, Any] = {"wrist": bool(options.wrist)}
    for (key, size), short_name in named.items():
        whole = known[short_name.removeprefix(PICTURES)]
        changes |= {key: whole, size: sizes[whole]}
    return changes


def _load(folder: Path, device: str | None) -> tuple[Any, Any, Any]:
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    config: Any = PreTrainedConfig.from_pretrained(folder)
    config.device = device or config.device
    policy = get_policy_class(config.type).from_pretrained(folder, config=config).to(config.device).eval()
    overrides = {"device_processor": {"device": config.device}}
    return policy, *make_pre_post_processors(config, str(folder), preprocessor_overrides=overrides)


@contextmanager
def _loading(name: str) -> Iterator[None]:
    """Redirect lerobot's output to stderr, and report its exceptions as usage errors."""
    try:
        with redirect_stdout(sys.stderr):
            yield
    except (ModuleNotFoundError, UsageError):
        raise
    except Exception as error:
        message = f"{name}: lerobot cannot load it: {type(error).__name__}: {short(error)}"
        raise UsageError(message, hint="load it in lerobot itself first") from None
