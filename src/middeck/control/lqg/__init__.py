"""Linear-quadratic Gaussian designs: weights, filter, regulator, and what they are extended by."""

from middeck.control.lqg.design import LQGCompensator, design_lqg
from middeck.control.lqg.estimator import KalmanFilter, design_filter
from middeck.control.lqg.weights import LQGWeights

__all__ = ["KalmanFilter", "LQGCompensator", "LQGWeights", "design_filter", "design_lqg"]
