"""Figure 7: the white torque, from the angle that the sheet states, and the weights of designs against it."""

from __future__ import annotations

import numpy as np

from middeck.control.loop.closed_loop import leave_open
from middeck.control.loop.performance import Performance, loop_metric
from middeck.control.lqg.weights import LQGWeights
from middeck.errors import NumericalError
from middeck.files.studies.documents import Study
from middeck.systems.plants.plant import Plant


def performance_under(study: Study, psd: float) -> Performance:
    """The metric in the stated band, under white torques of this intensity."""
    control = study.control
    intensity = psd * np.eye(len(control.disturbances))
    return Performance(np.array(control.metric_weights), intensity, control.band_hz)


def disturbance_psd(plant: Plant, study: Study) -> float:
    """S_w from 3 sigma = the stated angle; the metric is proportional to its root."""
    unit = loop_metric(leave_open(plant), performance_under(study, 1.0))
    if not 0.0 < unit < np.inf:
        raise NumericalError(
            f"under PD alone the metric in 0-g is {unit:g} for a unit disturbance, which no intensity scales",
            where="control",
            hint="a disturbance that the metric sees, and pd_kd_nms_per_rad that damp every reachable mode",
        )
    return float((np.radians(study.control.three_sigma_deg) / 3.0 / unit) ** 2)


def design_weights(study: Study, psd: float) -> LQGWeights:
    """The sheet's weights and noise: disturbance and a small torque noise on every input, white sensors."""
    control = study.control
    n_w, n_u, n_y = len(control.disturbances), len(control.inputs), len(control.angles)
    process = np.diag([psd] * n_w + [control.actuator_noise_ratio * psd] * n_u)
    sensor = [control.angle_noise_rad_per_rthz**2] * n_y + [control.rate_noise_rad_per_s_per_rthz**2] * n_y
    return LQGWeights(
        output=np.array(control.metric_weights),
        input=np.array(control.input_weight),
        disturbed=(*control.disturbances, *control.inputs),
        process=process,
        sensor=np.array(sensor),
    )
