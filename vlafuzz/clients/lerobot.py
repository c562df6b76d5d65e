"""LeRobot: a policy in a folder, in the user's own installation of lerobot, in this process."""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, redirect_stdout
from copy import copy, deepcopy
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar, Literal

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from vlafuzz.clients.conventions import ROTATIONS
from vlafuzz.clients.layouts import width
from vlafuzz.clients.profiled import Model, Profiled
from vlafuzz.clients.remote import Address, Common, needed
from vlafuzz.clients.wire import numbers, short
from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.harness import check_chunks

INSTALL = "pip install lerobot, into the environment of vlafuzz"
PICTURES = "observation.images."
EMPTY = "empty_camera"  # of SmolVLA: a picture that it does without
REMEMBERED = (
    "_queues",
    "_action_queue",
    "temporal_ensembler",
)  # what policies of lerobot 0.4 keep of a rollout


class LeRobotOptions(Profiled):
    """What the user says about the policy. Its own card says which pictures and how many numbers it takes.

    Attributes:
        image_key: which of its pictures is the third person's; its only one needs no name.
        device: as torch calls it; None for lerobot's choice.
    """

    protocol: ClassVar[str] = "lerobot"

    state_key: Literal["observation.state"] = "observation.state"
    instruction_key: Literal["task"] = "task"
    device: str | None = Field(default=None, pattern=r"^(cpu|mps|cuda(:\d+)?)$")


@dataclass(frozen=True)
class Card:
    """What a policy says about itself.

    Attributes:
        pictures: width and height in pixels by key.
        state: how many numbers of proprioception it takes, 0 for none; ``actions``: how many an action has.
        execute: actions of a chunk to execute.
        stepwise: it wants to see every step, for it remembers some.
        device: on which it runs; on a CPU it repeats itself.
    """

    kind: str
    pictures: Mapping[str, tuple[int, int]]
    state: int
    actions: int
    execute: int
    stepwise: bool = False
    device: str = "cpu"


class LeRobot:
    """A policy in a folder, as lerobot saves it, in this process: ?profile=libero&device=cuda.

    It needs lerobot, which the user installs beside vlafuzz. One model serves all workers. Noise comes from
    the rollout's seed and step, an observation at a time: in a batch it would depend on the company.
    """

    form: ClassVar[str] = "lerobot:FOLDER"
    schemes: ClassVar[Sequence[str]] = ()  # no server: a folder
    options: ClassVar[type[Common]] = LeRobotOptions
    shared: ClassVar[bool] = True

    def __init__(self, address: Address[LeRobotOptions]) -> None:
        folder = Path(address.url).expanduser()
        if not (folder / "config.json").is_file():
            hint = "name the folder that lerobot saved"
            missing = "no config.json there" if folder.is_dir() else "no such folder"
            raise UsageError(f"{address.name}: {missing}", hint)
        with needed(address.name, INSTALL), _told(address.name):
            self._policy, self._before, self._after = _load(folder, address.options.device)
        card = _card(address.name, self._policy.config)
        options = fitted(address.name, address.options, card)
        self._name, self._card, self._model = address.name, card, Model(address.name, options)
        self.spec = self._model.spec
        self._live: dict[str, tuple[EpisodeStart, dict[str, Any]]] = {}

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts begin, each with a memory of its own."""
        for start in episodes:
            self._policy.reset()
            made = vars(self._policy)
            self._live[start.episode] = start, {key: copy(made[key]) for key in REMEMBERED if key in made}

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """One after the other; when one of them breaks, it has gone on with none."""
        several = self._card.stepwise and len(observations) > 1
        before = deepcopy({name: memory for name, (_, memory) in self._live.items()}) if several else {}
        try:
            chunks = [ActionChunk(self._decided(seen)) for seen in observations]
            check_chunks(chunks, len(observations), self._name)
        except BaseException:
            for name, memory in before.items():
                self._live[name][1].update(memory)
            raise
        return chunks

    def finish(self, episodes: Sequence[EpisodeStart]) -> None:
        """Forget them."""
        for start in episodes:
            self._live.pop(start.episode, None)

    def close(self) -> None:
        """No more rollouts."""
        self._live.clear()

    def _decided(self, seen: Observation) -> NDArray[np.float64]:
        import torch
        from lerobot.policies.utils import prepare_observation_for_inference

        if seen.episode not in self._live:
            raise PolicyError(f"{self._name}: no live rollout {seen.episode!r}", cause="protocol")
        start, memory = self._live[seen.episode]
        device, told = torch.device(self._policy.config.device), self._model.message(seen)
        task = told.pop("task")
        vars(self._policy).update(memory)
        seed = np.random.SeedSequence([start.seed, seen.step]).generate_state(1)[0]
        with torch.no_grad(), torch.random.fork_rng([device] if device.type == "cuda" else []):
            torch.manual_seed(int(seed))
            told = {key: np.array(value) for key, value in told.items()}  # lerobot keeps them
            batch = self._before(prepare_observation_for_inference(told, device, task=task))
            choose = self._policy.select_action if self._card.stepwise else self._policy.predict_action_chunk
            found = self._after(choose(batch))
        memory.update({key: vars(self._policy)[key] for key in memory})
        try:
            return self._model.actions(numbers(found.reshape(-1, found.shape[-1]).cpu().numpy()), seen)
        except ValueError as error:
            raise PolicyError(f"{self._name}: {error}", cause="bad_action") from None


def fitted(name: str, options: LeRobotOptions, card: Card) -> LeRobotOptions:
    """The options with what the policy says about itself.

    Raises:
        UsageError: they do not say what its pictures, its state or its actions are.
    """
    front, wrist = _pictures(name, options, card)
    layout = options.layout
    there = width(layout) if layout else 0
    if card.state != there:
        told = f"{name}: the policy takes {card.state} numbers of state, state={layout or 0} has {there}"
        raise UsageError(told, hint="name their layout: state=…")
    expected = 4 + ROTATIONS[options.rotation][0]
    if card.actions != expected:
        told = f"its actions have {card.actions} numbers, a hand's have {expected} with {options.rotation}"
        raise UsageError(f"{name}: {told}", hint="joints cannot be executed; another rotation=…, perhaps")
    if card.stepwise and options.execute not in (None, 1):
        raise UsageError(f"{name}: {card.kind} remembers past steps, so it sees each", hint="leave execute")
    changes: dict[str, Any] = {"camera": (0, 0), "wrist": wrist is not None}
    if front is not None:
        changes |= {"image_key": front, "camera": card.pictures[front]}
    if wrist is not None:
        changes |= {"wrist_key": wrist, "wrist_camera": card.pictures[wrist]}
    execute = 1 if card.stepwise else options.execute or card.execute
    same = options.deterministic or card.device == "cpu"
    return options.model_copy(update=changes | {"execute": execute, "deterministic": same})


def _pictures(name: str, options: LeRobotOptions, card: Card) -> tuple[str | None, str | None]:
    """The keys of the third person's picture and of the wrist's."""
    there = {key.removeprefix(PICTURES): key for key in card.pictures if EMPTY not in key}
    if len(there) == 1 and not options.wrist and "image_key" not in options.model_fields_set:
        return next(iter(there.values())), None
    named = [] if options.camera == (0, 0) else [options.image_key]
    named += [options.wrist_key] if options.wrist else []
    if {key.removeprefix(PICTURES) for key in named} != set(there):
        takes, given = ", ".join(there) or "none", ", ".join(named) or "none"
        told = f"{name}: the policy takes the pictures {takes}, the options name {given}"
        raise UsageError(told, hint="say which is which: image_key=…&wrist=1&wrist_key=…")
    found = [there[key.removeprefix(PICTURES)] for key in named]
    return (found.pop(0) if options.camera != (0, 0) else None), (found.pop() if found else None)


def _card(name: str, config: Any) -> Card:
    """From lerobot's ``PreTrainedConfig``, whose pictures have the shape (3, height, width)."""
    if config.env_state_feature is not None:
        told = f"{name}: the policy wants the state of its environment"
        raise UsageError(told, hint="name one that sees pictures only")
    state, actions = config.robot_state_feature, config.action_feature
    if actions is None:
        raise UsageError(f"{name}: the policy has no actions", hint="name the folder of a policy")
    return Card(
        config.type,
        {key: (int(part.shape[2]), int(part.shape[1])) for key, part in config.image_features.items()},
        int(state.shape[0]) if state else 0,
        int(actions.shape[0]),
        int(getattr(config, "n_action_steps", 1)),
        config.n_obs_steps > 1 or getattr(config, "temporal_ensemble_coeff", None) is not None,
        str(config.device),
    )


def _load(folder: Path, device: str | None) -> tuple[Any, Any, Any]:
    """The policy, and what comes before and after it."""
    from lerobot.configs.policies import PreTrainedConfig
    from lerobot.policies.factory import get_policy_class, make_pre_post_processors

    config: Any = PreTrainedConfig.from_pretrained(folder)
    config.device = device or config.device
    policy = get_policy_class(config.type).from_pretrained(folder, config=config).to(config.device).eval()
    overrides = {"device_processor": {"device": config.device}}
    return policy, *make_pre_post_processors(config, str(folder), preprocessor_overrides=overrides)


@contextmanager
def _told(name: str) -> Iterator[None]:
    """Whatever lerobot says goes to stderr, and whatever it stumbles over is told in a sentence."""
    try:
        with redirect_stdout(sys.stderr):
            yield
    except (ModuleNotFoundError, UsageError):
        raise
    except Exception as error:
        told = f"{name}: lerobot cannot load it: {type(error).__name__}: {short(error)}"
        raise UsageError(told, hint="load it in lerobot itself first") from None
