"""Client: the class of a policy behind a model server."""

from collections.abc import Sequence
from typing import Any, Protocol

from vlafuzz.policies.base import Policy


class Client(Protocol):
    """The class of a policy behind a model server.

    ``form`` shows how users name it. ``options``: a class of ``clients.remote.CommonOptions``. Without
    ``schemes``, the policy is in a folder instead of at an address. With ``answers_batches`` set, its
    servers answer several observations in one call of the model.
    """

    form: str
    schemes: Sequence[str]
    options: Any

    def __call__(self, address: Any) -> Policy:
        """Connect to a server; PrerequisiteError when none answers, UsageError when it is not supported."""
