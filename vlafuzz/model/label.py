"""Model: a policy's name with a label, since an address does not say which model answers there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from urllib.parse import parse_qsl

from vlafuzz.errors import UsageError


@dataclass(frozen=True)
class Model:
    """A policy by its name, and the label that says which model answers under it; empty: nobody said."""

    policy: str
    label: str = ""

    def __str__(self) -> str:
        return f"{self.label} ({self.policy})" if self.label else self.policy

    @property
    def short(self) -> str:
        """The label with the address, but without options, which may be long."""
        return f"{self.label} ({self.address})" if self.label else self.policy

    @property
    def address(self) -> str:
        """Where it is asked: a server's address, a folder, or the name of another policy."""
        return self.policy.partition("?")[0]

    @property
    def which(self) -> str:
        """The name of the model: its label, or the ``version`` in the policy's name."""
        return self.label or dict(parse_qsl(self.policy.partition("?")[2])).get("version", "")

    def replaces(self, other: Model) -> bool:
        """Whether the two are asked at one address, but are different models: then one at a time can be."""
        return self.address == other.address and self.which != other.which


def check_label(flag: str, label: str | None) -> None:
    """Raise a UsageError for a label that does not fit into a line of text."""
    if label and not re.fullmatch(r"[\w.:@+/-]{1,100}", label):
        problem = f"{flag} {label!r}: expected up to 100 letters, digits and . : @ + / - _"
        raise UsageError(problem, hint=f"such as {flag} step-40000")
