"""Figures from results, one file a figure; matplotlib is imported here and nowhere further in."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
