"""Linear-quadratic Gaussian designs: weights, filter, regulator, shaping filters and topologies."""

from middeck.control.lqg.coloured_plant import colour_disturbances
from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.control.lqg.estimator import KalmanFilter, design_filter
from middeck.control.lqg.levels import design_levels
from middeck.control.lqg.shaping import Shaping
from middeck.control.lqg.spectra import SpectrumFit, fit_spectrum, line_filter, sum_spectra
from middeck.control.lqg.topologies import Topology, TopologyTable, compare_topologies
from middeck.control.lqg.weights import LQGWeights

__all__ = [
    "KalmanFilter",
    "LQGCompensator",
    "LQGWeights",
    "Shaping",
    "SpectrumFit",
    "Topology",
    "TopologyTable",
    "colour_disturbances",
    "compare_topologies",
    "design_filter",
    "design_levels",
    "design_lqg",
    "fit_spectrum",
    "line_filter",
    "sum_spectra",
]
