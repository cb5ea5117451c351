"""A model at the end of a search."""

from __future__ import annotations

import functools

import numpy as np
from jaxtyping import Complex

from middeck.identification.model.descent import Refined
from middeck.identification.problem.data import Data
from middeck.identification.problem.design import residual_of
from middeck.identification.problem.layout import Layout, Start
from middeck.values import record


@record(kw_only=True)
class Run:
    """A model at the end of a search.

    Parameters
    ----------
    likelihood:
        Negative logarithm of the likelihood, up to a constant: sum of log v + |r|^2 / v.
    """

    layout: Layout
    refined: Refined
    likelihood: float

    @functools.cached_property
    def start(self) -> Start:
        """From where it is refined further."""
        return Start(self.layout, self.refined.theta)

    def residual(self, data: Data) -> Complex[np.ndarray, "output line column"]:
        """H - E, unweighted."""
        return residual_of(self.layout, data, self.refined.theta, self.refined.step.linear)
