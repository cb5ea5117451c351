"""Names of this room that ``middeck`` itself does not have."""

from .analysis.margins.disk import measure_disk_margin as measure_disk_margin
from .analysis.margins.return_ratio import trace_return_ratio as trace_return_ratio
from .analysis.shifts.inversion import find_inversion as find_inversion
from .analysis.shifts.worst_case import find_worst_case as find_worst_case
from .h2.law_form import LawForm as LawForm
from .law.uncertainty import draw_positions as draw_positions
from .loop.pointing import (
    PointingWindow as PointingWindow,
    budget_pointing as budget_pointing,
)
from .lqg.disturbance_spectra import colour_disturbances as colour_disturbances
from .lqg.disturbance_spectra import (
    fit_spectrum as fit_spectrum,
    line_filter as line_filter,
    sum_spectra as sum_spectra,
)
from .robust.designs.plant_as_sampled import plant_as_sampled as plant_as_sampled
from .robust.designs.worst_of_many import design_for_worst as design_for_worst
from .robust.designs.popov import design_popov as design_popov
from .robust.designs.sensitivity_weighted import design_sensitivity_weighted as design_sensitivity_weighted
from .robust.verification.many_loops import (
    close_many as close_many,
    measure_many as measure_many,
)
from .robust.verification.monte_carlo import verify_robustness as verify_robustness
from .sampled.aliases import find_aliases as find_aliases
from .sampled.aliases import filter_measurements as filter_measurements
from .sampled.compare_sampling import compare_sampling as compare_sampling
from .shaping.leads_and_notches import roll_off as roll_off

__all__: list[str]
