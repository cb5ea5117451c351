"""Control: from a `Plant` to a `Compensator`, and the behaviour of the closed loop.

Feedback sign: a compensator's output is ADDED at the plant's input, u = K(s) y; a minus sign is inside K.
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
