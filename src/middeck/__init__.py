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
    from middeck.files.measured_modes import load_measured_modes, write_measured_modes
    from middeck.files.models import load_model, write_compensator, write_model
    from middeck.files.records import load_record, load_records, split_periods, write_record
    from middeck.files.studies import load_study
    from middeck.identification.fit.fit_response import fit_response
    from middeck.identification.plants.measured_plant import measured_plant
    from middeck.identification.simulation import nrmse
    from middeck.identification.spectra import estimate_response
    from middeck.realtime.nonlinear_rig import build_nonlinear_rig, run_nonlinear_open_loop
    from middeck.structure.article import Damping
    from middeck.structure.checks.summary import summarise
    from middeck.structure.comparison import compare_modes
    from middeck.structure.correlation.correlate import correlate_modes
    from middeck.structure.correlation.effective_mass import measure_effective_mass
    from middeck.structure.correlation.measured_modes import MeasuredModes, MeasurementNoise, measure_modes
    from middeck.structure.correlation.profiles import find_profile
    from middeck.structure.correlation.reduction import Reduction
    from middeck.structure.environment import AnchoredSpring, Device, DeviceKind, Environment, Suspension
    from middeck.structure.equilibrium import solve_equilibrium
    from middeck.structure.gimbals.amplitude import sweep_amplitude
    from middeck.structure.gimbals.family import sweep_gimbals
    from middeck.structure.gravity.budget import build_budget
    from middeck.structure.gravity.path import follow_gravity
    from middeck.structure.gravity.places import find_place, tilt_place
    from middeck.structure.modes import solve_modes
    from middeck.structure.plants.damping import estimate_damping
    from middeck.structure.plants.modal_plant import build_plant
    from middeck.structure.plants.port_rows import accelerometer_offset
    from middeck.structure.plants.residual import compare_static_gain
    from middeck.structure.sensitivity.frequencies import differentiate_frequencies
    from middeck.structure.sensitivity.parameters import find_parameters, list_parameters
    from middeck.structure.sensitivity.plants import differentiate_plant
    from middeck.structure.sensitivity.rest import differentiate_rest
    from middeck.structure.sensitivity.shapes import differentiate_modes
    from middeck.structure.suspension.attitude import estimate_attitude
    from middeck.structure.suspension.device_friction import estimate_rest_band, sweep_device_amplitude
    from middeck.structure.suspension.levelling import level
    from middeck.systems.deadband import Deadband
    from middeck.systems.friction import Friction
    from middeck.systems.response import evaluate_plant

__version__ = "0.1.0"

_ROOM = {
    "AnchoredSpring": "structure.environment",
    "Damping": "structure.article",
    "Deadband": "systems.deadband",
    "Device": "structure.environment",
    "DeviceKind": "structure.environment",
    "Environment": "structure.environment",
    "Friction": "systems.friction",
    "LQGWeights": "control.lqg",
    "MeasuredModes": "structure.correlation.measured_modes",
    "MeasurementNoise": "structure.correlation.measured_modes",
    "MiddeckError": "errors",
    "PDLoops": "control.classical",
    "Performance": "control.performance",
    "Reduction": "structure.correlation.reduction",
    "Suspension": "structure.environment",
    "accelerometer_offset": "structure.plants.port_rows",
    "build_budget": "structure.gravity.budget",
    "build_nonlinear_rig": "realtime.nonlinear_rig",
    "build_plant": "structure.plants.modal_plant",
    "close_inner_loop": "control.classical",
    "close_loop": "control.closed_loop",
    "compare_modes": "structure.comparison",
    "compare_static_gain": "structure.plants.residual",
    "correlate_modes": "structure.correlation.correlate",
    "design_filter": "control.lqg",
    "design_lqg": "control.lqg",
    "differentiate_frequencies": "structure.sensitivity.frequencies",
    "differentiate_modes": "structure.sensitivity.shapes",
    "differentiate_plant": "structure.sensitivity.plants",
    "differentiate_rest": "structure.sensitivity.rest",
    "estimate_attitude": "structure.suspension.attitude",
    "estimate_damping": "structure.plants.damping",
    "estimate_response": "identification.spectra",
    "estimate_rest_band": "structure.suspension.device_friction",
    "evaluate_plant": "systems.response",
    "find_first_instability": "control.authority",
    "find_parameters": "structure.sensitivity.parameters",
    "find_place": "structure.gravity.places",
    "find_profile": "structure.correlation.profiles",
    "fit_response": "identification.fit.fit_response",
    "follow_gravity": "structure.gravity.path",
    "leave_open": "control.closed_loop",
    "level": "structure.suspension.levelling",
    "list_parameters": "structure.sensitivity.parameters",
    "load_case": "files.documents",
    "load_environment": "files.documents",
    "load_measured_modes": "files.measured_modes",
    "load_model": "files.models",
    "load_record": "files.records",
    "load_records": "files.records",
    "load_structure": "files.documents",
    "load_study": "files.studies",
    "measure_effective_mass": "structure.correlation.effective_mass",
    "measure_metric": "control.performance",
    "measure_modes": "structure.correlation.measured_modes",
    "measure_rms": "control.performance",
    "measured_plant": "identification.plants.measured_plant",
    "nrmse": "identification.simulation",
    "run_nonlinear_open_loop": "realtime.nonlinear_rig",
    "solve_equilibrium": "structure.equilibrium",
    "solve_modes": "structure.modes",
    "split_periods": "files.records",
    "summarise": "structure.checks.summary",
    "sweep_amplitude": "structure.gimbals.amplitude",
    "sweep_authority": "control.authority",
    "sweep_device_amplitude": "structure.suspension.device_friction",
    "sweep_gimbals": "structure.gimbals.family",
    "tilt_place": "structure.gravity.places",
    "write_compensator": "files.models",
    "write_measured_modes": "files.measured_modes",
    "write_model": "files.models",
    "write_record": "files.records",
}

__all__ = [
    "AnchoredSpring",
    "Damping",
    "Deadband",
    "Device",
    "DeviceKind",
    "Environment",
    "Friction",
    "LQGWeights",
    "MeasuredModes",
    "MeasurementNoise",
    "MiddeckError",
    "PDLoops",
    "Performance",
    "Reduction",
    "Suspension",
    "__version__",
    "accelerometer_offset",
    "build_budget",
    "build_nonlinear_rig",
    "build_plant",
    "close_inner_loop",
    "close_loop",
    "compare_modes",
    "compare_static_gain",
    "correlate_modes",
    "design_filter",
    "design_lqg",
    "differentiate_frequencies",
    "differentiate_modes",
    "differentiate_plant",
    "differentiate_rest",
    "estimate_attitude",
    "estimate_damping",
    "estimate_response",
    "estimate_rest_band",
    "evaluate_plant",
    "find_first_instability",
    "find_parameters",
    "find_place",
    "find_profile",
    "fit_response",
    "follow_gravity",
    "leave_open",
    "level",
    "list_parameters",
    "load_case",
    "load_environment",
    "load_measured_modes",
    "load_model",
    "load_record",
    "load_records",
    "load_structure",
    "load_study",
    "measure_effective_mass",
    "measure_metric",
    "measure_modes",
    "measure_rms",
    "measured_plant",
    "nrmse",
    "run_nonlinear_open_loop",
    "solve_equilibrium",
    "solve_modes",
    "split_periods",
    "summarise",
    "sweep_amplitude",
    "sweep_authority",
    "sweep_device_amplitude",
    "sweep_gimbals",
    "tilt_place",
    "write_compensator",
    "write_measured_modes",
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
