"""Operators and bounds of visibility as conditions keep them, and how they are read again."""

import json
from collections.abc import Collection
from pathlib import Path

from vlafuzz.errors import StoreError
from vlafuzz.model.conditions import Conditions
from vlafuzz.worlds.manipulation.base import Visible
from vlafuzz.worlds.manipulation.operator_set import OperatorSet, load_operators
from vlafuzz.worlds.manipulation.operators import EXTRAS, OPERATORS


def operators_json(operators: OperatorSet) -> str:
    """Operators with their ranges as a field of conditions."""
    ranges = {name: operator.model_dump(mode="json") for name, operator in operators.decisive.items()}
    varied = sorted(operators.varied)
    return json.dumps(
        {"min_distance": operators.min_distance, "varied": varied, "operators": ranges}, sort_keys=True
    )


def stored_operators(
    source: Path, conditions: Conditions, vary: Collection[str] | None = None
) -> OperatorSet:
    """The operators that ``operators_json`` wrote, of which those in ``vary`` vary, by default as then.

    ``source`` is the store or corpus, for messages.
    """
    try:
        stored = json.loads(conditions.operators)
        written = {
            name: kind.model_validate(stored["operators"][name])
            for name, kind in OPERATORS.items()
            if name in stored["operators"] or name not in EXTRAS
        }
        operators = OperatorSet(
            source=source,
            min_distance=stored["min_distance"],
            operators={**load_operators().operators, **written},
            varied=frozenset(stored["varied"]),
            visible=stored_visible(conditions),
        )
    except (KeyError, ValueError, TypeError) as error:
        raise StoreError(
            f"{source}: its operators are those of another version: {' '.join(str(error).split())}",
            hint="use the version that began the run",
        ) from None
    return operators if vary is None else operators.only(vary)


def visible_json(visible: Visible | None) -> str:
    """Bounds of visibility as a field of conditions."""
    return visible.model_dump_json() if visible else ""


def stored_visible(conditions: Conditions) -> Visible | None:
    """The bounds that ``visible_json`` wrote; a ValueError if another version did."""
    return Visible.model_validate_json(conditions.visible) if conditions.visible else None
