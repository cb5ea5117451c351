"""Names of this room that ``middeck`` itself does not have."""

from .fit.fit_result import FitResult as FitResult
from .friction.find import find_friction as find_friction
from .friction.remove import without_friction as without_friction
from .impact.averaged_blows import average_blows as average_blows
from .impact.fit_of_blows import without_window as without_window
from .model.measurement_model import damping_ratio as damping_ratio
from .model.channel_selection import select_channels as select_channels
from .model.steady_simulation import nrmse as nrmse
from .plants.modal_parameters import modal_parameters as modal_parameters
from .plants.pole_zero_gain import pole_zero_gain as pole_zero_gain
from .plants.zeros import (
    name_zeros as name_zeros,
    path_zeros as path_zeros,
)
from .spectra.averages import estimate_spectra as estimate_spectra
from .spectra.coherence import (
    multiple_coherence as multiple_coherence,
    ordinary_coherence as ordinary_coherence,
)
from .spectra.distortion import estimate_distortion as estimate_distortion
from .spectra.estimate import response_scatter as response_scatter
from .tracking.tracked_state import start_tracking as start_tracking
from .tracking.kalman_filter import update_tracking as update_tracking
from .uncertainty.model_set import sample_models as sample_models
from .uncertainty.parameter_deviations import parameters_of as parameters_of
from .uncertainty.response_bounds import (
    response_bounds as response_bounds,
    simultaneous_bounds as simultaneous_bounds,
)

__all__: list[str]
