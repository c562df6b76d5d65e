"""A run's operators with their ranges, as its manifest keeps them."""

from __future__ import annotations

import json
from pathlib import Path

from vlafuzz.errors import StoreError
from vlafuzz.space import OPERATORS, OperatorSet
from vlafuzz.store.records import Manifest


def operators_json(operators: OperatorSet) -> str:
    """What a manifest keeps of them."""
    ranges = {name: operator.model_dump(mode="json") for name, operator in operators.operators.items()}
    varied = sorted(operators.varied)
    return json.dumps(
        {"min_distance": operators.min_distance, "varied": varied, "operators": ranges}, sort_keys=True
    )


def stored_operators(store: Path, manifest: Manifest) -> OperatorSet:
    """Those of a manifest: what ``operators_json`` wrote, read back.

    Raises:
        StoreError: another version wrote it, whose operators are others.
    """
    try:
        found = json.loads(manifest.operators)
        operators = {name: kind.model_validate(found["operators"][name]) for name, kind in OPERATORS.items()}
        return OperatorSet(store, found["min_distance"], operators, frozenset(found["varied"]), {})
    except (KeyError, ValueError) as error:
        raise StoreError(
            f"{store}: its operators are those of another version: {' '.join(str(error).split())}",
            hint="go on with the version that began the run",
        ) from None
