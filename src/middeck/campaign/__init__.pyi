"""Names of this room that ``middeck`` itself does not have."""

from .cases import Case as Case
from .distributions import (
    LogNormal as LogNormal,
)
from .distributions import (
    Normal as Normal,
)
from .distributions import (
    TruncatedNormal as TruncatedNormal,
)
from .distributions import (
    Uniform as Uniform,
)
from .executors import (
    CampaignResult as CampaignResult,
)
from .executors import (
    Progress as Progress,
)
from .executors import (
    run_campaign as run_campaign,
)
from .ledger import Outcome as Outcome
from .samplers import (
    Group as Group,
)
from .samplers import (
    Parameter as Parameter,
)
from .samplers import (
    full_factorial as full_factorial,
)
from .samplers import (
    latin_hypercube as latin_hypercube,
)
from .samplers import (
    monte_carlo as monte_carlo,
)
from .samplers import (
    sobol as sobol,
)

__all__: list[str]
