"""Measurement models from records: responses, fits with exact delays, and the plants they give.

measured = estimate_response(record, band_hz=(0.1, 60.0))
fitted = fit_response(measured, states=10)
plant = measured_plant(fitted.model, u=("torque",), y=("angle",))
"""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
