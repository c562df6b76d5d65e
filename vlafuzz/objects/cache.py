"""Cache of built objects: one folder each, named by the hash of its entry and the builder's version."""

from __future__ import annotations

import hashlib
import json
import shutil
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from vlafuzz import shipped
from vlafuzz.objects.model import Container, Fit, Grasp, ObjectModel, StablePose
from vlafuzz.objects.packs import PackObject
from vlafuzz.objects.schema import ObjectSpec

Entry = ObjectSpec | PackObject  # of a catalogue

BUILDER = 6  # version; raise it when the same entry builds a different object, which a test detects
NUMBERS = "model.json"


def fingerprint(name: str, spec: Entry) -> str:
    """Hash of an entry's values and the builder's version."""
    text = json.dumps([BUILDER, name, spec.model_dump(mode="json")], sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:20]


def built(name: str, spec: Entry) -> ObjectModel:
    """The object from the cache, built first if necessary."""
    place = f"objects/{name.replace(':', '-')}-{fingerprint(name, spec)}"
    fill, is_complete = partial(_fill, name, spec), lambda folder: (folder / NUMBERS).is_file()
    model = _load(shipped.made_once(place, fill, is_complete), spec)
    # SAPIEN only logs a missing mesh
    if all(file.is_file() for file in (model.visual, *model.collision)):
        return model
    shutil.rmtree(model.collision[0].parent, ignore_errors=True)
    return _load(shipped.made_once(place, fill, is_complete), spec)


def _fill(name: str, spec: Entry, folder: Path) -> None:
    # Imported here: trimesh and scipy are not needed when the object is cached
    if isinstance(spec, PackObject):
        from vlafuzz.objects.measured import build_measured

        save(build_measured(name, spec, folder), folder)
    else:
        from vlafuzz.objects.build import build

        save(build(name, spec, folder), folder)


def _load(folder: Path, spec: Entry) -> ObjectModel:
    """The visual mesh of a pack's object stays in the pack."""
    visual = spec.visual if isinstance(spec, PackObject) else None
    model = load(folder)
    return replace(model, visual=visual) if visual else model


def save(model: ObjectModel, folder: Path) -> None:
    data = _plain(vars(model))
    data["rests"] = data.pop("stable_poses")  # the files' key since the first version
    (folder / NUMBERS).write_text(json.dumps(data))


def _plain(value: Any) -> Any:
    match value:
        case np.ndarray():
            return value.tolist()
        case Path():
            return value.name
        case StablePose() | Grasp() | Container() | Fit():
            return _plain(vars(value))
        case dict():
            return {key: _plain(item) for key, item in value.items()}
        case tuple():
            return [_plain(item) for item in value]
    return value


def load(folder: Path) -> ObjectModel:
    """Read what ``save`` has written."""
    data = json.loads((folder / NUMBERS).read_text())
    data["colour"] = _array(data["colour"])
    data["vertices"] = _array(data["vertices"])
    data["parts"] = tuple(map(_array, data["parts"]))
    data["visual"] = folder / data["visual"]
    data["collision"] = tuple(folder / name for name in data["collision"])
    data["stable_poses"] = tuple(map(_stable_pose, data.pop("rests")))
    data["container"] = data["container"] and Container(**data["container"])
    data["fit"] = _fit(data.get("fit"))
    data["box"] = data.get("box") and _array(data["box"])
    return ObjectModel(**data)


def _fit(data: dict[str, Any] | None) -> Fit | None:
    if data is None:
        return None
    return Fit(data["scale"], _array(data["quaternion"]), _array(data["position"]))


def _stable_pose(data: dict[str, Any]) -> StablePose:
    data["quaternion"] = _array(data["quaternion"])
    data["footprint"] = _array(data["footprint"])
    data["grasps"] = tuple(Grasp(**grasp) for grasp in data["grasps"])
    return StablePose(**data)


def _array(values: list[Any]) -> Any:
    array = np.array(values, dtype=np.float64)
    array.flags.writeable = False  # models are shared
    return array
