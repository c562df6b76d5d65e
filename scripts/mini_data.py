"""Demonstrations for train_mini.py: as files, and as tensors, step by step."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import torch
from numpy.typing import NDArray
from torch import Tensor

from vlafuzz.policies.mini import words
from vlafuzz.policies.mini.model import HORIZON, LONG, proprioception

HELD_OUT = 50  # every 50th episode is for validation
ABOUT = "card.json"  # beside the demonstrations: what the card of weights is to say of the world
LATER = 0.25  # weight of the later steps of a chunk


@dataclass
class Data:
    """All steps on one device. ``frames`` (n, 128, 128, 3 * views) uint8; see ``load`` for the others."""

    frames: Tensor
    tokens: Tensor
    state: Tensor
    moves: Tensor
    gripper: Tensor
    weights: Tensor
    places: Tensor
    pixels: Tensor
    shown: Tensor
    rest: dict[str, Any]

    @property
    def views(self) -> int:
        """The number of cameras."""
        return self.frames.shape[-1] // 3

    def drawn(self, batch: int, share: float) -> Tensor:
        """Numbers of random steps to learn from; that share of them are replayed ones, if there are any."""
        own, replayed = self.rest["own"], self.rest["replayed"]
        old = round(share * batch) if len(replayed) else 0
        return torch.cat([_some(own, batch - old), _some(replayed, old)])


def write(steps: Sequence[dict[str, Any]], folder: Path) -> None:
    """Write the steps of several demonstrations of one task as arrays."""
    folder.mkdir(parents=True, exist_ok=True)
    np.save(folder / "frames.npy", np.stack([step["frame"] for step in steps]))
    texts = sorted({step["text"] for step in steps})
    index = {text: number for number, text in enumerate(texts)}
    table: dict[str, Any] = {
        key: np.stack([step[key] for step in steps]).astype(np.float32)
        for key in ("state", "label", "gripper", "taught", "places", "pixels")
    }
    table["texts"] = np.array(texts)
    table["text"] = np.array([index[step["text"]] for step in steps], dtype=np.int32)
    for key, kind in (("targets", np.int8), ("episode", np.int64)):
        table[key] = np.array([step[key] for step in steps], dtype=kind)
    np.savez(folder / "steps.npz", **table)


def vocabulary(texts: Sequence[str]) -> tuple[str, ...]:
    """All words of these texts, in alphabetical order; ValueError when there are more than ``KNOWN``."""
    known = sorted({word for text in texts for word in words.WORD.findall(text.lower())})
    if len(known) > words.KNOWN:
        raise ValueError(f"{len(known)} words, at most {words.KNOWN}")
    return tuple(known)


def load(folder: Path, device: str, known: tuple[str, ...] = (), replayed: Path | None = None) -> Data:
    """All demonstrations below a folder, in chunks: ``moves`` (n, HORIZON, 6), ``weights`` (n, HORIZON).

    ``known``: the vocabulary of the weights to continue from; by default that of the texts. ``replayed``: a folder of
    earlier demonstrations.
    """
    folders = [folder, replayed] if replayed else [folder]
    paths = [path.parent for each in folders for path in sorted(each.glob("*/steps.npz"))]
    parts = [dict(np.load(path / "steps.npz")) for path in paths]
    frames = [torch.from_numpy(np.load(path / "frames.npy")) for path in paths]
    known = known or vocabulary([str(text) for part in parts for text in part["texts"]])
    joined = {key: np.concatenate([part[key] for part in parts]) for key in parts[0] if key != "texts"}
    source = np.repeat(np.arange(len(parts)), [len(part["text"]) for part in parts])
    pairs = np.stack([source, joined["episode"]], axis=1)
    episodes = np.unique(pairs, axis=0, return_inverse=True)[1].reshape(-1)
    tables = tabulate(joined, episodes)
    tables["tokens"] = np.concatenate(
        [np.stack([words.encode(str(t), known) for t in part["texts"]])[part["text"]] for part in parts]
    )
    on_device = {name: torch.from_numpy(np.ascontiguousarray(table)).to(device) for name, table in tables.items()}
    old = np.array([replayed in path.parents for path in paths])[source]
    taught, held_out = joined["taught"] > 0, episodes % HELD_OUT == 0
    rest = {
        "words": known,
        "card": json.loads((folder / ABOUT).read_text()) if (folder / ABOUT).exists() else {},
        "hash": fingerprint(frames, joined["label"]),
        "episodes": int(episodes.max()) + 1,
        "frames": int(joined["taught"].sum()),
    }
    for name, which in {"own": ~held_out & ~old, "replayed": ~held_out & old, "held_out": held_out}.items():
        rest[name] = torch.from_numpy(np.flatnonzero(taught & which)).to(device)
    return Data(torch.cat([part.to(device) for part in frames]), **on_device, rest=rest)


def _some(index: Tensor, number: int) -> Tensor:
    return index[torch.randint(len(index), (number,), device=index.device)] if number else index[:0]


def tabulate(joined: dict[str, Any], episodes: NDArray[np.int64]) -> dict[str, NDArray[Any]]:
    """The tables of ``Data`` with one row per step, without frames and words."""
    label, opening, pixels = joined["label"], joined["state"][:, 6], joined["pixels"]
    same = np.append(False, episodes[1:] == episodes[:-1])
    before = np.where(same, np.roll(opening, 1), opening)
    index = np.minimum(np.arange(len(label))[:, None] + np.arange(HORIZON), len(label) - 1)
    inside = episodes[index] == episodes[:, None]
    weights = np.where(inside, np.where(np.arange(HORIZON) == 0, 1.0, LATER), 0.0)
    shown = np.all((pixels > 0) & (pixels < 1), axis=-1)
    shown[:, 1] &= joined["targets"] > 1
    return {
        "state": proprioception(joined["state"], before, since_change(joined["gripper"], same)),
        "moves": label[index][..., :6].astype(np.float32),
        "gripper": (label[index][..., 6] > 0).astype(np.float32),
        "weights": weights.astype(np.float32),
        "places": joined["places"],
        "pixels": pixels,
        "shown": shown,
    }


def fingerprint(frames: Sequence[Tensor], label: NDArray[np.float32]) -> str:
    """Digest of the demonstrations: all labels, and about fifty frames of each part."""
    digest = hashlib.sha256()
    for part in frames:
        digest.update(part.numpy()[:: max(len(part) // 50, 1)].tobytes())
    digest.update(label.tobytes())
    return digest.hexdigest()[:20]


def since_change(commands: NDArray[np.float32], same: NDArray[np.bool_]) -> NDArray[np.int64]:
    """Steps since the gripper command changed, as `mini` counts; ``same``: the episode did not change."""
    since, last = np.empty(len(commands), dtype=np.int64), 1.0
    for index, inside in enumerate(same):
        if not inside:
            since[index], last = LONG, 1.0
            continue
        command = np.sign(commands[index - 1])
        since[index] = since[index - 1] + 1 if command == last else 1
        last = command
    return since
