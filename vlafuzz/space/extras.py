"""The extra operators: what each varies beside the paper's ten. They are off by default."""

from __future__ import annotations

from vlafuzz.space.base import Extra

ALL: tuple[type[Extra], ...] = ()
