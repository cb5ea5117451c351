"""Names of this room that ``middeck`` itself does not have."""

from .plants.mode_blocks import part_modes as part_modes
from .plants.plant import group_ports as group_ports
from .state_space.statespace import StateSpace as StateSpace

__all__: list[str]
