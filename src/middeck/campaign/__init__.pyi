"""Names of this room that ``middeck`` itself does not have."""

from .cases import Case as Case
from .distributions import (
    LogNormal as LogNormal,
    Normal as Normal,
    TruncatedNormal as TruncatedNormal,
    Uniform as Uniform,
)
from .run_cases import (
    CampaignResult as CampaignResult,
    Progress as Progress,
    run_campaign as run_campaign,
)
from .ledger import Outcome as Outcome
from .samplers import (
    Group as Group,
    Parameter as Parameter,
    full_factorial as full_factorial,
    latin_hypercube as latin_hypercube,
    monte_carlo as monte_carlo,
    sobol as sobol,
)

__all__: list[str]
