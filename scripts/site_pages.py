"""Hook of mkdocs: pages of the site that lie elsewhere in the checkout, as their folders need them."""

import re
from pathlib import Path
from typing import Any

from mkdocs.structure.files import File

ROOT = Path(__file__).parent.parent
ELSEWHERE = ("CHANGELOG.md", "CONTRIBUTING.md", "corpus/README.md", "operators/README.md")
_OUTSIDE = re.compile(r"\]\(\.\./(" + "|".join(map(re.escape, ELSEWHERE)) + r")([#)])")


def on_files(files: Any, config: Any) -> None:
    """Add them under their own paths."""
    for name in ELSEWHERE:
        files.append(File.generated(config, name, abs_src_path=str(ROOT / name)))


def on_page_markdown(markdown: str, page: Any, **_: Any) -> str:
    """Links as they work in the checkout, made to work in the site: ``docs/`` is its top."""
    if page.file.src_uri in ELSEWHERE:
        return markdown.replace("](docs/", "](").replace("](../docs/", "](../")
    return _OUTSIDE.sub(r"](\1\2", markdown)
