"""Operators with their ranges as conditions keep them."""

from __future__ import annotations

import json
from pathlib import Path

from vlafuzz.conditions.conditions import Conditions
from vlafuzz.errors import StoreError
from vlafuzz.space import OPERATORS, OperatorSet, load_operators
from vlafuzz.space.operators import EXTRAS


def operators_json(operators: OperatorSet) -> str:
    """Operators as a field of conditions."""
    ranges = {name: operator.model_dump(mode="json") for name, operator in operators.decisive.items()}
    varied = sorted(operators.varied)
    return json.dumps(
        {"min_distance": operators.min_distance, "varied": varied, "operators": ranges}, sort_keys=True
    )


def stored_operators(source: Path, conditions: Conditions) -> OperatorSet:
    """The operators that ``operators_json`` wrote.

    Args:
        source: store or corpus that the conditions are from, for messages.

    Raises:
        StoreError: they were written by a version with other operators.
    """
    try:
        stored = json.loads(conditions.operators)
        written = {
            name: kind.model_validate(stored["operators"][name])
            for name, kind in OPERATORS.items()
            if name in stored["operators"] or name not in EXTRAS
        }
        operators = {**load_operators().operators, **written}
        return OperatorSet(source, stored["min_distance"], operators, frozenset(stored["varied"]), {})
    except (KeyError, ValueError) as error:
        raise StoreError(
            f"{source}: its operators are those of another version: {' '.join(str(error).split())}",
            hint="use the version that began the run",
        ) from None
