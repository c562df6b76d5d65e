"""Groot: a model behind GR00T's policy server."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray
from pydantic import AfterValidator, BaseModel, ConfigDict, ValidationError

from vlafuzz.clients.layouts import width
from vlafuzz.clients.profiled import Model, Profiled
from vlafuzz.clients.remote import Address, Common, needed
from vlafuzz.clients.wire import failure, persistently, required, short
from vlafuzz.errors import PolicyError, UsageError
from vlafuzz.policies.base import ActionChunk, EpisodeStart, Observation
from vlafuzz.policies.harness import check_chunks


def parts_of(text: str) -> dict[str, int]:
    """``x,gripper:2`` as names, and how many numbers each of them has."""
    found: dict[str, int] = {}
    for part in text.split(","):
        name, _, count = part.partition(":")
        if not name or name in found or (count and not 0 < int(count) < 100):
            raise ValueError(f"expected names as x,y,gripper:2, each of them once, got {text!r}")
        found[name] = int(count or 1)
    return found


def _checked(text: str) -> str:
    parts_of(text)
    return text


Parts = Annotated[str, AfterValidator(_checked)]


class GrootOptions(Profiled):
    """What the user says about the model. The keys are those of its SimplerEnv and LIBERO models.

    Attributes:
        state_key: in which parts proprioception is sent: their names, in the layout's order.
        action_key: in which parts actions come: position, rotation, gripper.
        flat: the server was started with --use-sim-policy-wrapper.
    """

    protocol: ClassVar[str] = "groot"

    state_key: Parts = "x,y,z,roll,pitch,yaw,gripper"
    action_key: Parts = "x,y,z,roll,pitch,yaw,gripper"
    instruction_key: str = "annotation.human.action.task_description"
    flat: bool = False

    def refusals(self) -> list[tuple[str, str]]:
        """Also parts that are not the layout's."""
        found, layout = super().refusals(), self.layout
        named, there = sum(parts_of(self.state_key).values()), width(layout) if layout else 0
        if layout and named != there:
            told = f"state_key: its parts have {named} numbers, {layout} has {there}"
            found.append((told, "such as state_key=x,y,z,roll,pitch,yaw,gripper:2"))
        return found


class Modality(BaseModel):
    """One kind of what a model takes or gives. ``delta_indices``: a moment each, 0 for now."""

    model_config = ConfigDict(frozen=True)

    delta_indices: tuple[int, ...]
    modality_keys: tuple[str, ...]


NONE = Modality(delta_indices=(0,), modality_keys=())


class Modalities(BaseModel):
    """What a model takes and gives, as its server says."""

    model_config = ConfigDict(frozen=True)

    video: Modality = NONE
    state: Modality = NONE
    language: Modality = NONE
    action: Modality


class Groot:
    """A model behind GR00T's policy server, of N1.6 or N1.7; name a profile: ?profile=libero.

    The server keeps nothing of a rollout: all observations go in one request, and once more when the
    connection breaks.
    """

    form: ClassVar[str] = "groot:tcp://host:port"
    schemes: ClassVar[Sequence[str]] = ("tcp",)
    options: ClassVar[type[Common]] = GrootOptions

    def __init__(self, address: Address[GrootOptions]) -> None:
        with needed(address.name):
            from vlafuzz.clients import groot_wire
            from vlafuzz.clients import zmq_connection as zmq_line
        self._address, self._options, self._wire, self._zmq = address, address.options, groot_wire, zmq_line
        self._line: zmq_line.ZmqLine | None = None
        self._model = Model(address.name, address.options)
        self.spec = self._model.spec
        with required("GR00T", "start it first: python gr00t/eval/run_gr00t_server.py …"):
            self._modalities = self._asked_for_modalities()
        try:
            _check_modalities(address.name, self._modalities, self._sent())
        except BaseException:
            self.close()
            raise

    def reset(self, episodes: Sequence[EpisodeStart]) -> None:
        """These rollouts begin, with the model that it was at first."""
        if self._asked_for_modalities() != self._modalities:
            told = f"{self._address.name}: another server answers than at the beginning of the run"
            raise PolicyError(told, cause="protocol")
        self._ask("reset", {"options": None})

    def act(self, observations: Sequence[Observation]) -> list[ActionChunk]:
        """All of them in one request."""
        if not observations:
            return []
        found = self._ask("get_action", {"observation": self._message(observations), "options": None})
        if not isinstance(found, list) or not found or not isinstance(found[0], dict):
            raise failure(self._address.url, f"no actions, but {short(found)}", "protocol")
        try:
            together = self._joined(found[0], len(observations))
            pairs = zip(together, observations, strict=True)
            chunks = [ActionChunk(self._model.actions(actions, seen)) for actions, seen in pairs]
        except ValueError as error:
            raise PolicyError(f"{self._address.name}: {error}", cause="bad_action") from None
        check_chunks(chunks, len(observations), self._address.name)
        return chunks

    def close(self) -> None:
        """Let go of the connection."""
        if self._line is not None:
            self._line.close()
        self._line = None

    def _asked_for_modalities(self) -> Modalities:
        try:
            return Modalities.model_validate(self._ask("get_modality_config"))
        except ValidationError as error:
            first = error.errors(include_url=False)[0]
            where = ".".join(str(step) for step in first["loc"]) or "all of it"
            self.close()
            told = f"its modality config: {where}: {first['msg']}"
            raise failure(self._address.url, told, "protocol") from None

    def _sent(self) -> dict[str, tuple[str, ...]]:
        """The keys that the options name, by kind."""
        options = self._options
        named = {"front": options.image_key, "wrist": options.wrist_key}
        return {
            "video": tuple(named[camera.name] for camera in self.spec.cameras),
            "state": tuple(parts_of(options.state_key)) if options.layout else (),
            "language": (options.instruction_key,),
            "action": tuple(parts_of(options.action_key)),
        }

    def _message(self, observations: Sequence[Observation]) -> dict[str, Any]:
        """By kind and key, of all observations, each at one moment: (count, 1, …)."""
        told, sent, options = list(map(self._model.message, observations)), self._sent(), self._options
        found: dict[str, dict[str, Any]] = {"state": {}, "language": {}}
        found["video"] = {key: np.stack([each[key] for each in told])[:, None] for key in sent["video"]}
        if options.layout:
            ends = np.cumsum([*parts_of(options.state_key).values()])[:-1]
            parts = np.split(np.stack([each[options.state_key] for each in told]), ends, axis=1)
            found["state"] = {key: part[:, None] for key, part in zip(sent["state"], parts, strict=True)}
        said = [each[options.instruction_key] for each in told]
        if options.flat:
            flat = {f"{kind}.{key}": value for kind, by_key in found.items() for key, value in by_key.items()}
            return flat | {options.instruction_key: said}
        return found | {"language": {options.instruction_key: [[text] for text in said]}}

    def _joined(self, found: Mapping[str, Any], count: int) -> NDArray[np.float64]:
        """``(count, steps, n)`` of the parts of the actions."""
        parts = []
        for key, numbers in parts_of(self._options.action_key).items():
            part = found.get(key, found.get(f"action.{key}"))
            if not isinstance(part, np.ndarray) or part.dtype.kind not in "iuf":
                raise ValueError(f"a reply without the action {key!r}, but {short(sorted(map(str, found)))}")
            if part.ndim != 3 or (len(part), part.shape[2]) != (count, numbers):
                told = f"the action {key!r} has shape {part.shape}"
                raise ValueError(f"{told}, expected ({count}, steps, {numbers})")
            parts.append(part.astype(np.float64))
        return np.concatenate(parts, axis=2)

    def _ask(self, endpoint: str, data: Mapping[str, Any] | None = None) -> Any:
        message = {"endpoint": endpoint} | ({} if data is None else {"data": data})
        found = persistently(lambda: self._attempt(message))
        if isinstance(found, dict) and "error" in found:
            raise failure(self._address.url, short(found["error"]), "remote")
        return found

    def _attempt(self, message: object) -> Any:
        """The connection is opened where there is none, and let go of when it breaks."""
        try:
            if self._line is None:
                self._line = self._zmq.ZmqLine(self._address.url, self._options.timeout)
            return self._wire.unpack(self._line.ask(self._wire.pack(message)))
        except BaseException as error:
            self.close()
            if isinstance(error, ValueError):
                raise failure(self._address.url, f"not a GR00T message: {error}", "protocol") from None
            raise


def _check_modalities(name: str, there: Modalities, sent: Mapping[str, tuple[str, ...]]) -> None:
    """Whether every key of the model is named, and no other."""
    named = {"video": "image", "state": "state", "language": "instruction", "action": "action"}
    for kind, keys in sent.items():
        modality: Modality = getattr(there, kind)
        if set(keys) != set(modality.modality_keys):
            asked, given = ", ".join(modality.modality_keys) or "none", ", ".join(keys) or "none"
            told = f"{name}: the model's keys of {kind} are {asked}, and the options name {given}"
            raise UsageError(told, hint=f"a profile, or the option {named[kind]}_key=…")
        if kind != "action" and len(modality.delta_indices) != 1:
            told = f"{name}: the model wants {len(modality.delta_indices)} moments of {kind}"
            raise UsageError(told, hint="supported: one, the present")
