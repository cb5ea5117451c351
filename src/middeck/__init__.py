"""Control of flexible structures that must work where they cannot be tested.

The public names, listed once in ``__init__.pyi``, lead from a structure or a record to a closed loop; each is
imported when it is first used. What is asked for less often is a name of its room: ``md.plot.draw_nyquist``.

>>> import middeck as md
>>> md.Environment.orbit().gravity.tolist()
[0.0, 0.0, 0.0]
>>> md.draw_nyquist
Traceback (most recent call last):
AttributeError: middeck has no 'draw_nyquist'; there is md.plot.draw_nyquist
"""

from pathlib import Path
from typing import Any

import lazy_loader

__version__ = "0.1.0"

_load, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)


def __getattr__(name: str) -> Any:
    try:
        return _load(name)
    except AttributeError:
        if name.startswith("_"):
            raise
        rooms = [room for room in __all__ if Path(__file__).with_name(room).is_dir()]
        found = [f"md.{room}.{name}" for room in rooms if name in _load(room).__all__]
        found += ["md.write(path, value)"] if name.startswith("write_") else []
        if not found:
            raise
    raise AttributeError(f"middeck has no {name!r}; there is {found[0]}")
