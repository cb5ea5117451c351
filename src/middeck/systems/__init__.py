"""Linear systems: state spaces, plants, responses, delays, norms.

Models of structures and of data end in a `Plant`; control begins with one, whatever its origin.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
