"""Names of this room that ``middeck`` itself does not have."""

from .excitation.recognition import cut_periods as cut_periods

__all__: list[str]
