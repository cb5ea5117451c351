"""Samples and the ports that they belong to: records, test signals, faults."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
