"""Two close modes that a response does not part beyond doubt: no sound mode in their place."""

import numpy as np
import pytest
from struck_plant import shaken

from middeck.identification.fit.fit_response import fit_response
from middeck.identification.model.measurement_model import natural_hz
from middeck.identification.spectra import estimate_response


@pytest.mark.parametrize(("hz", "other"), [((12.4, 12.44, 24.0), 1.0), ((9.0, 9.03, 22.0), 1.5)])
def test_a_mode_that_may_be_two_is_not_sound(hz, other):
    """0.3 % apart at 0.4 % damping: the one in their place was stated to a hundredth of its error."""
    plant = hz, (0.004, 0.004, 0.005), (1.0, other, 3.0), 0.005
    record = shaken(plant, 3000, 100.0, (1.0, 40.0), noise=0.01, seed=1)
    fitted = fit_response(estimate_response(record, band_hz=(1.0, 40.0), method="local rational"))
    for m, f in enumerate(natural_hz(fitted.model)):
        if fitted.standing[m] == "sound":
            assert np.min(np.abs(f - np.array(hz))) < 4.0 * fitted.uncertainty.natural_hz[m]
