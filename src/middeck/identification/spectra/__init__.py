"""Frequency responses from records: whole periods, local models, averaged spectra; what scatters them."""

from middeck.identification.spectra.averages import Spectra, doubts_of_window, estimate_spectra
from middeck.identification.spectra.coherence import multiple_coherence, ordinary_coherence
from middeck.identification.spectra.distortion import Distortion, estimate_distortion
from middeck.identification.spectra.estimate import Method, estimate_response, response_scatter
from middeck.identification.spectra.h1_h2_hv import Ratio, spectra_response
from middeck.identification.spectra.scattered_response import ResponseScatter

__all__ = [
    "Distortion",
    "Method",
    "Ratio",
    "ResponseScatter",
    "Spectra",
    "doubts_of_window",
    "estimate_distortion",
    "estimate_response",
    "estimate_spectra",
    "multiple_coherence",
    "ordinary_coherence",
    "response_scatter",
    "spectra_response",
]
