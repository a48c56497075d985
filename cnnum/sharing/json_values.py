"""Values as JSON has them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, cast


def json_value(value: object) -> object:
    """Return a value as JSON has it; a number that is not finite has no form there and is null."""
    if isinstance(value, Mapping):
        return {str(k): json_value(v) for k, v in cast(Mapping[object, object], value).items()}
    if isinstance(value, tuple | list):
        return [json_value(item) for item in cast(Sequence[object], value)]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    item = getattr(cast(Any, value), "item", None)
    return json_value(item()) if item is not None else value
