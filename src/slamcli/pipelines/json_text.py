# SPDX-License-Identifier: MIT
"""Documents as JSON that every parser takes: no NaN, no Infinity, no arrays of NumPy."""

from __future__ import annotations

import json
import math
from collections.abc import Mapping
from typing import Any


def json_text(document: Any) -> str:
    """Return the document as JSON text; what is not finite becomes null, arrays lists, and what has no JSON form its text."""
    return json.dumps(plain(document), indent=2, allow_nan=False)


def plain(value: Any) -> Any:
    """Return the value as JSON can hold it: dictionaries, lists, text, finite numbers, true, false and null."""
    if isinstance(value, Mapping):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if hasattr(value, "tolist"):
        return plain(value.tolist())
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    return value if value is None or isinstance(value, str | int) else str(value)
