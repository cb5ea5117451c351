"""The simulated laboratory: an article with hidden errors, its rig, its bench and its experiments."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
