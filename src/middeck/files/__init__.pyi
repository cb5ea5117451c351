"""Names of this room that ``middeck`` itself does not have."""

from .articles.components import load_component as load_component
from .exchange.matlab_systems import (
    load_mat as load_mat,
    write_mat as write_mat,
)
from .exchange.named_system import as_compensator as as_compensator
from .exchange.scipy_signal import (
    from_scipy as from_scipy,
    to_scipy as to_scipy,
)
from .laws.blacklists import (
    add_to_blacklist as add_to_blacklist,
    load_blacklist as load_blacklist,
)
from .laws.gate_logs import (
    GateLog as GateLog,
    load_gate_log as load_gate_log,
)
from .laws.verdicts import load_verdicts as load_verdicts
from .measured.models import load_model as load_model
from .measured.modes import write_measured_modes as write_measured_modes
from .records import (
    load_campaign as load_campaign,
    load_response as load_response,
    write_response as write_response,
)
from .records.columns import name_columns as name_columns
from .records.experiments_and_periods import split_periods as split_periods

__all__: list[str]
