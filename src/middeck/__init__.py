"""Control of flexible structures that must work where they cannot be tested.

The names in ``__all__`` lead from a structure or a record to a closed loop; each is imported when first used:

>>> import middeck as md
>>> md.Environment.orbit().gravity.tolist()
[0.0, 0.0, 0.0]
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from middeck.control.authority import find_first_instability, sweep_authority
    from middeck.control.classical import PDLoops, close_inner_loop
    from middeck.control.closed_loop import close_loop, leave_open
    from middeck.control.lqg import LQGWeights, design_filter, design_lqg
    from middeck.control.performance import Performance, measure_metric, measure_rms
    from middeck.errors import MiddeckError
    from middeck.files.documents import load_case, load_environment, load_structure
    from middeck.files.models import load_model, write_compensator, write_model
    from middeck.files.records import load_record, load_records, split_periods, write_record
    from middeck.files.studies import load_study
    from middeck.identification.fit import fit_response
    from middeck.identification.measurement_model import measured_plant
    from middeck.identification.simulation import nrmse
    from middeck.identification.spectra import estimate_response
    from middeck.structure.article import Damping
    from middeck.structure.comparison import compare_modes
    from middeck.structure.environment import Environment
    from middeck.structure.equilibrium import solve_equilibrium
    from middeck.structure.modes import solve_modes
    from middeck.structure.plants.modal_plant import build_plant
    from middeck.systems.response import evaluate_plant

__version__ = "0.1.0"

_ROOM = {
    "Damping": "structure.article",
    "Environment": "structure.environment",
    "LQGWeights": "control.lqg",
    "MiddeckError": "errors",
    "PDLoops": "control.classical",
    "Performance": "control.performance",
    "build_plant": "structure.plants.modal_plant",
    "close_inner_loop": "control.classical",
    "close_loop": "control.closed_loop",
    "compare_modes": "structure.comparison",
    "design_filter": "control.lqg",
    "design_lqg": "control.lqg",
    "estimate_response": "identification.spectra",
    "evaluate_plant": "systems.response",
    "find_first_instability": "control.authority",
    "fit_response": "identification.fit",
    "leave_open": "control.closed_loop",
    "load_case": "files.documents",
    "load_environment": "files.documents",
    "load_model": "files.models",
    "load_record": "files.records",
    "load_records": "files.records",
    "load_structure": "files.documents",
    "load_study": "files.studies",
    "measure_metric": "control.performance",
    "measure_rms": "control.performance",
    "measured_plant": "identification.measurement_model",
    "nrmse": "identification.simulation",
    "solve_equilibrium": "structure.equilibrium",
    "solve_modes": "structure.modes",
    "sweep_authority": "control.authority",
    "write_compensator": "files.models",
    "write_model": "files.models",
    "split_periods": "files.records",
    "write_record": "files.records",
}

__all__ = [
    "Damping",
    "Environment",
    "LQGWeights",
    "MiddeckError",
    "PDLoops",
    "Performance",
    "__version__",
    "build_plant",
    "close_inner_loop",
    "close_loop",
    "compare_modes",
    "design_filter",
    "design_lqg",
    "estimate_response",
    "evaluate_plant",
    "find_first_instability",
    "fit_response",
    "leave_open",
    "load_case",
    "load_environment",
    "load_model",
    "load_record",
    "load_records",
    "load_structure",
    "load_study",
    "measure_metric",
    "measure_rms",
    "measured_plant",
    "nrmse",
    "solve_equilibrium",
    "solve_modes",
    "split_periods",
    "sweep_authority",
    "write_compensator",
    "write_model",
    "write_record",
]


def __getattr__(name: str) -> object:
    """Import a public name when it is first used (PEP 562); ``import middeck`` alone costs nothing."""
    if name not in _ROOM:
        raise AttributeError(f"module 'middeck' has no attribute {name!r}")
    value = getattr(import_module(f"middeck.{_ROOM[name]}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    """The public names, for completion."""
    return sorted(__all__)
