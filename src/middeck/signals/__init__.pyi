"""Names of this room that ``middeck`` itself does not have."""

from .excitation.binary_signals import (
    design_binary as design_binary,
    design_mls as design_mls,
)
from .excitation.band_noise import (
    design_burst as design_burst,
    design_noise as design_noise,
)
from .excitation.recognition import (
    cut_periods as cut_periods,
    recognise_excitation as recognise_excitation,
)
from .excitation.signal import Excitation as Excitation
from .excitation.sweep import design_sweep as design_sweep

__all__: list[str]
