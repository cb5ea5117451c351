"""What tests compute alike, computed once."""

from __future__ import annotations

import functools
import pickle
from collections import OrderedDict
from collections.abc import Callable
from typing import Any


def once(function: Callable[..., Any], kept: int | None = None) -> Callable[..., Any]:
    """``function``, computed once for arguments of the same values; of ``kept`` results the latest remain."""
    done: OrderedDict[bytes, Any] = OrderedDict()

    @functools.wraps(function)
    def known(*asked: Any, **named: Any) -> Any:
        key = pickle.dumps((asked, named))
        if key not in done:
            done[key] = function(*asked, **named)
        done.move_to_end(key)
        if kept is not None and len(done) > kept:
            done.popitem(last=False)
        return done[key]

    return known
