"""Fuzz one reader of foreign files, guided by the coverage of its code, with atheris (pip install atheris).

    scripts/fuzz_readers.py scene -max_total_time=300      flags behind the name are libFuzzer's
    scripts/fuzz_readers.py scene FOLDER                   goes on with the inputs that it kept in a folder

A reader may refuse its input in a sentence. Anything else ends the fuzzing, and the input is kept in a file.
"""

import sys
import tempfile
from collections.abc import Callable
from contextlib import suppress
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).resolve().parents[1]))
with atheris.instrument_imports(include=["vlafuzz"]):
    from vlafuzz.common.reading import decoded, npy_array
    from vlafuzz.errors import UsageError, VlafuzzError
    from vlafuzz.failures.corpus.folder import read_corpus
    from vlafuzz.model.scene import Scene
    from vlafuzz.model.scene_lines import load_scenes
    from vlafuzz.policies.clients.msgpack_wire import unpack_groot, unpack_openpi, unpack_vla_eval
    from vlafuzz.policies.clients.options import load_profile
    from vlafuzz.worlds.tabletop.objects.references import check_references
    from vlafuzz.worlds.tabletop.space import load_operators

FOLDER = Path(tempfile.mkdtemp(prefix="fuzz-readers-"))


def of_file(name: str, read: Callable[[Path], object]) -> Callable[[bytes], object]:
    """A reader of bytes from a reader of files."""

    def reader(data: bytes) -> object:
        (FOLDER / name).write_bytes(data)
        return read(FOLDER / name)

    return reader


READERS: dict[str, Callable[[bytes], object]] = {
    "scene": Scene.from_json,
    "scenes": of_file("a.jsonl", load_scenes),
    "manifest": of_file("manifest.json", lambda path: read_corpus(path.parent)),
    "operators": of_file("a.yaml", load_operators),
    "profile": of_file("a.yaml", load_profile),
    "array": npy_array,
    "picture": lambda data: decoded(data, "PNG", "JPEG"),
    **{
        kind: of_file(f"a.{kind}", lambda path: check_references(path, FOLDER))
        for kind in ("obj", "mtl", "dae", "glb", "urdf")
    },
    "openpi": unpack_openpi,
    "groot": unpack_groot,
    "vla-eval": unpack_vla_eval,
}
OURS = Path(__file__).parents[1]
SEEDS = {  # shipped files to begin with
    "scenes": "corpus/mini-pick-up/controls.jsonl",
    "manifest": "corpus/mini-pick-up/manifest.json",
    "operators": "operators/paper-*.yaml",
    "profile": "vlafuzz/policies/clients/profiles/*.yaml",
    "array": "corpus/mini-pick-up/witnesses/*.npy",
    "picture": "corpus/mini-pick-up/thumbnails/*.png",
}


def main() -> None:
    name, *flags = sys.argv[1:] or [""]
    if name not in READERS:
        sys.exit(f"expected a reader: {', '.join(READERS)}")
    # Readers of bytes raise ValueError, which their callers turn into sentences.
    fair = VlafuzzError if name not in ("array", "picture", "openpi", "groot", "vla-eval") else ValueError

    def once(data: bytes) -> None:
        with suppress(fair, UsageError):
            READERS[name](data)

    if all(flag.startswith("-") for flag in flags):
        flags.append(tempfile.mkdtemp(prefix="fuzz-seeds-"))
        for path in OURS.glob(SEEDS.get(name, "corpus/mini-pick-up/controls.jsonl")):
            Path(flags[-1], path.name).write_bytes(path.read_bytes().partition(b"\n{")[0])
    atheris.Setup([sys.argv[0], *flags], once)
    atheris.Fuzz()


if __name__ == "__main__":
    main()
