"""Names of this room that ``middeck`` itself does not have."""

from .correlation.frequencies import compare_frequencies as compare_frequencies
from .correlation.measured_modes import (
    MeasurementNoise as MeasurementNoise,
    measure_modes as measure_modes,
)
from .correlation.review_criteria import (
    Quantity as Quantity,
    change_limit as change_limit,
    find_profile as find_profile,
)
from .correlation.reduction import Reduction as Reduction
from .gimbals.amplitude import sweep_amplitude as sweep_amplitude
from .model.article import PointLoad as PointLoad
from .model.component import Component as Component
from .modes.results.article_drawing import (
    Drawing as Drawing,
    build_mode_drawing as build_mode_drawing,
)
from .modes.results.component_outputs import recover_outputs as recover_outputs
from .plants.residual_flexibility import compare_static_gain as compare_static_gain
from .rest.link_loads import link_loads as link_loads
from .sensitivity.parameters import find_parameters as find_parameters
from .sensitivity.rest import differentiate_rest as differentiate_rest
from .sensitivity.shape_derivatives import differentiate_modes as differentiate_modes
from .hanging.attitude import estimate_attitude as estimate_attitude
from .hanging.device_friction import (
    estimate_rest_band as estimate_rest_band,
    sweep_device_amplitude as sweep_device_amplitude,
)

__all__: list[str]
