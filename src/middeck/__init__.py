"""Control of flexible structures that must work where they cannot be tested.

The public names, listed once in ``__init__.pyi``, lead from a structure or a record to a closed loop; each is
imported when it is first used. What is asked for less often is a name of its room: ``md.plot.draw_nyquist``.

>>> import middeck as md
>>> md.Environment.orbit().gravity.tolist()
[0.0, 0.0, 0.0]
"""

import lazy_loader

__version__ = "0.1.0"

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
