"""Profiles: the options of known models, so that users need not give them one by one."""

from collections.abc import Mapping
from functools import cache
from pathlib import Path
from typing import Any

from pydantic import BaseModel, field_validator

from vlafuzz.common.reading import read_yaml, validated
from vlafuzz.errors import UsageError, suggestion

FOLDER = Path(__file__).parent


class Profile(BaseModel, extra="forbid", frozen=True):
    """A kind of model. ``protocols``: overriding and additional options by protocol."""

    about: str
    source: str
    options: Mapping[str, Any]
    protocols: Mapping[str, Mapping[str, Any]]

    @field_validator("options")
    @classmethod
    def _names_no_other(cls, options: Mapping[str, Any]) -> Mapping[str, Any]:
        if "profile" in options:
            raise ValueError("a profile does not name another one")
        return options

    def options_for(self, protocol: str) -> Mapping[str, Any] | None:
        """All options for a protocol; None when no server of that protocol serves such models."""
        return {**self.options, **self.protocols[protocol]} if protocol in self.protocols else None


@cache
def known_profiles() -> Mapping[str, Profile]:
    """The built-in profiles by name."""
    return {path.stem: load_profile(path) for path in sorted(FOLDER.glob("*.yaml"))}


def load_profile(path: Path) -> Profile:
    """Read a profile from a file; UsageError when this fails."""
    content = read_yaml(path, UsageError, hint="name a profile, or a file of one")
    hint = f"it has the keys {', '.join(Profile.model_fields)}: see those in {FOLDER}"
    return validated(Profile, content, path, UsageError, hint)


def options_of(name: str, protocol: str) -> Mapping[str, Any]:
    """The options for a protocol in a profile, a built-in one or a ``.yaml`` file; UsageError when none."""
    known = known_profiles()
    if name.endswith((".yaml", ".yml")):
        profile = load_profile(Path(name))
    elif name in known:
        profile = known[name]
    else:
        raise UsageError(f"unknown profile {name!r}", hint=f"{suggestion(name, known)} or a file: mine.yaml")
    options = profile.options_for(protocol)
    if options is None:
        message = f"the profile {name!r} says nothing about {protocol}"
        raise UsageError(message, hint=f"it covers {', '.join(profile.protocols)}")
    return options
