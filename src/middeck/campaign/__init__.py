"""Campaigns: many cases from samplers, run once each on a pool of processes, kept in a ledger."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
