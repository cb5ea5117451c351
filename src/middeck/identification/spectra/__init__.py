"""Frequency responses from records: whole periods, local models, averaged spectra; what scatters them."""

from middeck.identification.spectra.estimate import estimate_response, response_scatter
from middeck.identification.spectra.scatter import ResponseScatter

__all__ = ["ResponseScatter", "estimate_response", "response_scatter"]
