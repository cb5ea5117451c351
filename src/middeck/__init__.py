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
    from middeck.control.analysis.delayed_rms import measure_delayed_rms
    from middeck.control.analysis.disk import measure_disk_margin
    from middeck.control.analysis.inversion import find_inversion
    from middeck.control.analysis.margins import measure_margins
    from middeck.control.analysis.margins_table import margins_table
    from middeck.control.analysis.return_ratio import trace_return_ratio
    from middeck.control.analysis.shifts import find_allowed_shifts
    from middeck.control.analysis.stability import decide_stability
    from middeck.control.analysis.worst_case import find_worst_case
    from middeck.control.authority import find_first_instability, sweep_authority
    from middeck.control.classical import PDLoops, close_inner_loop
    from middeck.control.closed_loop import close_loop, leave_open
    from middeck.control.lqg.coloured_plant import colour_disturbances
    from middeck.control.lqg.design import design_lqg
    from middeck.control.lqg.estimator import design_filter
    from middeck.control.lqg.levels import design_levels
    from middeck.control.lqg.shaping import Shaping
    from middeck.control.lqg.spectra import fit_spectrum, line_filter, sum_spectra
    from middeck.control.lqg.topologies import compare_topologies
    from middeck.control.lqg.weights import LQGWeights
    from middeck.control.participation import find_participation, find_participations
    from middeck.control.performance import Performance, measure_control_rms, measure_metric, measure_rms
    from middeck.control.pointing import PointingWindow, budget_pointing
    from middeck.control.qualification import qualify_compensator
    from middeck.control.reduction.compensators import reduce_compensator
    from middeck.control.reduction.modal import reduce_modes
    from middeck.control.reduction.plants import reduce_plant
    from middeck.control.riccati.continuous import solve_riccati
    from middeck.control.riccati.discrete import solve_discrete_riccati
    from middeck.control.robust.comparison import compare_designs, comparison_table
    from middeck.control.robust.exchange import design_for_worst
    from middeck.control.robust.monte_carlo import verify_robustness
    from middeck.control.robust.multimodel import design_multimodel
    from middeck.control.robust.popov import design_popov
    from middeck.control.robust.sampled_plant import plant_as_sampled
    from middeck.control.robust.sensitivity_weighted import design_sensitivity_weighted
    from middeck.control.robust.structure import Structure
    from middeck.control.sampled.aliases import find_aliases
    from middeck.control.sampled.antialias import filter_measurements
    from middeck.control.sampled.comparison import compare_sampling
    from middeck.control.sampled.design import design_sampled_lqg
    from middeck.control.sampled.emulation import emulate
    from middeck.control.sampled.margins import (
        find_sampled_shifts,
        measure_sampled_disk,
        measure_sampled_margins,
    )
    from middeck.control.sampled.outcome import measure_sampled_loop
    from middeck.control.sampled.sampling_table import sampling_table
    from middeck.control.sampled_compensator import SampledCompensator
    from middeck.control.shaping.sections import (
        design_pd,
        first_order_section,
        notch,
        roll_off,
        second_order_section,
        shape_compensator,
    )
    from middeck.control.uncertainty import ModeShift, Uncertainty, draw_positions
    from middeck.errors import MiddeckError
    from middeck.files.compensators import load_compensator, write_compensator
    from middeck.files.documents import load_case, load_environment, load_structure
    from middeck.files.exchange.mat import load_mat, write_mat
    from middeck.files.exchange.named import as_compensator, as_plant
    from middeck.files.exchange.python_control import from_control, to_control
    from middeck.files.exchange.scipy_signal import from_scipy, to_scipy
    from middeck.files.measured_modes import load_measured_modes, write_measured_modes
    from middeck.files.models import load_fitted, load_model, write_model
    from middeck.files.records import (
        load_campaign,
        load_record,
        load_records,
        load_response,
        open_record,
        read_record,
        write_record,
        write_response,
        write_stream,
    )
    from middeck.files.records.columns import name_columns
    from middeck.files.records.together import split_periods
    from middeck.files.studies import load_study
    from middeck.identification.faults.detect import detect_faults
    from middeck.identification.fit.fit_response import fit_response
    from middeck.identification.fit.stabilisation import stabilisation
    from middeck.identification.measurement_model import MeasurementModel, model_response
    from middeck.identification.plants.delays import merge_delays
    from middeck.identification.plants.measured_plant import delayed_plant, measured_plant, sampled_plant
    from middeck.identification.plants.modal_parameters import modal_parameters
    from middeck.identification.plants.pole_zero_gain import from_pole_zero_gain, pole_zero_gain
    from middeck.identification.plants.reduction import minimal_model
    from middeck.identification.plants.selection import scale_channels, select_channels
    from middeck.identification.plants.zeros import matrix_zeros, name_zeros, path_zeros
    from middeck.identification.samples.fit_record import fit_record
    from middeck.identification.samples.simulation import record_nrmse, simulate_record
    from middeck.identification.simulation import nrmse
    from middeck.identification.spectra.averages import estimate_spectra
    from middeck.identification.spectra.coherence import (
        multiple_coherence,
        ordinary_coherence,
        partial_coherence,
    )
    from middeck.identification.spectra.distortion import estimate_distortion
    from middeck.identification.spectra.estimate import estimate_response, response_scatter
    from middeck.identification.spectra.ratios import spectra_response
    from middeck.identification.tracking.follow import start_tracking
    from middeck.identification.tracking.history import track_modes
    from middeck.identification.tracking.update import update_tracking
    from middeck.identification.uncertainty.accuracy import expected_accuracy, periods_needed
    from middeck.identification.uncertainty.drift import compare_fits
    from middeck.identification.uncertainty.model_set import sample_models
    from middeck.identification.uncertainty.parameters import parameters_of
    from middeck.identification.uncertainty.response_bounds import response_bounds, simultaneous_bounds
    from middeck.identification.uncertainty.response_drift import compare_responses
    from middeck.realtime.drift import Drift, age_plant, nearest_modes
    from middeck.realtime.events import StopRule
    from middeck.realtime.hardware_rig import build_hardware_rig
    from middeck.realtime.hardware_runs import run_hardware_closed_loop, run_hardware_open_loop
    from middeck.realtime.motors import Motor
    from middeck.realtime.nonlinear_rig import build_nonlinear_rig, run_nonlinear_open_loop
    from middeck.realtime.sensors import Encoder, Gyro
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
    from middeck.systems.delayed_plant import DelayedPlant, approximate_delays, delay_inputs
    from middeck.systems.excitation.binary import design_binary, design_mls
    from middeck.systems.excitation.limits import Limits
    from middeck.systems.excitation.multisine import design_multisine
    from middeck.systems.excitation.noise import design_burst, design_noise
    from middeck.systems.excitation.recognition import cut_periods, recognise_excitation
    from middeck.systems.excitation.signal import Excitation
    from middeck.systems.excitation.sweep import design_stepped_sine, design_sweep
    from middeck.systems.friction import Friction
    from middeck.systems.peak_gain import peak_gain
    from middeck.systems.ports import Channel, Port
    from middeck.systems.record import Campaign, Record, RecordStream
    from middeck.systems.response import evaluate_plant
    from middeck.systems.sampled_plant import build_sampled_plant
    from middeck.systems.sampling import tustin

__version__ = "0.1.0"

_ROOM = {
    "AnchoredSpring": "structure.environment",
    "Campaign": "systems.record",
    "Channel": "systems.ports",
    "Damping": "structure.article",
    "Deadband": "systems.deadband",
    "DelayedPlant": "systems.delayed_plant",
    "Device": "structure.environment",
    "DeviceKind": "structure.environment",
    "Drift": "realtime.drift",
    "Encoder": "realtime.sensors",
    "Environment": "structure.environment",
    "Excitation": "systems.excitation.signal",
    "Friction": "systems.friction",
    "Gyro": "realtime.sensors",
    "LQGWeights": "control.lqg.weights",
    "Limits": "systems.excitation.limits",
    "MeasuredModes": "structure.correlation.measured_modes",
    "MeasurementModel": "identification.measurement_model",
    "MeasurementNoise": "structure.correlation.measured_modes",
    "MiddeckError": "errors",
    "ModeShift": "control.uncertainty",
    "Motor": "realtime.motors",
    "PDLoops": "control.classical",
    "Performance": "control.performance",
    "PointingWindow": "control.pointing",
    "Port": "systems.ports",
    "Record": "systems.record",
    "RecordStream": "systems.record",
    "Reduction": "structure.correlation.reduction",
    "SampledCompensator": "control.sampled_compensator",
    "Shaping": "control.lqg.shaping",
    "StopRule": "realtime.events",
    "Structure": "control.robust.structure",
    "Suspension": "structure.environment",
    "Uncertainty": "control.uncertainty",
    "accelerometer_offset": "structure.plants.port_rows",
    "age_plant": "realtime.drift",
    "approximate_delays": "systems.delayed_plant",
    "as_compensator": "files.exchange.named",
    "as_plant": "files.exchange.named",
    "budget_pointing": "control.pointing",
    "build_budget": "structure.gravity.budget",
    "build_hardware_rig": "realtime.hardware_rig",
    "build_nonlinear_rig": "realtime.nonlinear_rig",
    "build_plant": "structure.plants.modal_plant",
    "build_sampled_plant": "systems.sampled_plant",
    "close_inner_loop": "control.classical",
    "close_loop": "control.closed_loop",
    "colour_disturbances": "control.lqg.coloured_plant",
    "compare_designs": "control.robust.comparison",
    "compare_fits": "identification.uncertainty.drift",
    "compare_modes": "structure.comparison",
    "compare_responses": "identification.uncertainty.response_drift",
    "compare_sampling": "control.sampled.comparison",
    "compare_static_gain": "structure.plants.residual",
    "compare_topologies": "control.lqg.topologies",
    "comparison_table": "control.robust.comparison",
    "correlate_modes": "structure.correlation.correlate",
    "cut_periods": "systems.excitation.recognition",
    "decide_stability": "control.analysis.stability",
    "delay_inputs": "systems.delayed_plant",
    "delayed_plant": "identification.plants.measured_plant",
    "design_binary": "systems.excitation.binary",
    "design_burst": "systems.excitation.noise",
    "design_filter": "control.lqg.estimator",
    "design_for_worst": "control.robust.exchange",
    "design_levels": "control.lqg.levels",
    "design_lqg": "control.lqg.design",
    "design_mls": "systems.excitation.binary",
    "design_multimodel": "control.robust.multimodel",
    "design_multisine": "systems.excitation.multisine",
    "design_noise": "systems.excitation.noise",
    "design_pd": "control.shaping.sections",
    "design_popov": "control.robust.popov",
    "design_sampled_lqg": "control.sampled.design",
    "design_sensitivity_weighted": "control.robust.sensitivity_weighted",
    "design_stepped_sine": "systems.excitation.sweep",
    "design_sweep": "systems.excitation.sweep",
    "detect_faults": "identification.faults.detect",
    "differentiate_frequencies": "structure.sensitivity.frequencies",
    "differentiate_modes": "structure.sensitivity.shapes",
    "differentiate_plant": "structure.sensitivity.plants",
    "differentiate_rest": "structure.sensitivity.rest",
    "draw_positions": "control.uncertainty",
    "emulate": "control.sampled.emulation",
    "estimate_attitude": "structure.suspension.attitude",
    "estimate_damping": "structure.plants.damping",
    "estimate_distortion": "identification.spectra.distortion",
    "estimate_response": "identification.spectra.estimate",
    "estimate_rest_band": "structure.suspension.device_friction",
    "estimate_spectra": "identification.spectra.averages",
    "evaluate_plant": "systems.response",
    "expected_accuracy": "identification.uncertainty.accuracy",
    "filter_measurements": "control.sampled.antialias",
    "find_aliases": "control.sampled.aliases",
    "find_allowed_shifts": "control.analysis.shifts",
    "find_first_instability": "control.authority",
    "find_inversion": "control.analysis.inversion",
    "find_parameters": "structure.sensitivity.parameters",
    "find_participation": "control.participation",
    "find_participations": "control.participation",
    "find_place": "structure.gravity.places",
    "find_profile": "structure.correlation.profiles",
    "find_sampled_shifts": "control.sampled.margins",
    "find_worst_case": "control.analysis.worst_case",
    "first_order_section": "control.shaping.sections",
    "fit_record": "identification.samples.fit_record",
    "fit_response": "identification.fit.fit_response",
    "fit_spectrum": "control.lqg.spectra",
    "follow_gravity": "structure.gravity.path",
    "from_control": "files.exchange.python_control",
    "from_pole_zero_gain": "identification.plants.pole_zero_gain",
    "from_scipy": "files.exchange.scipy_signal",
    "leave_open": "control.closed_loop",
    "level": "structure.suspension.levelling",
    "line_filter": "control.lqg.spectra",
    "list_parameters": "structure.sensitivity.parameters",
    "load_campaign": "files.records",
    "load_case": "files.documents",
    "load_compensator": "files.compensators",
    "load_environment": "files.documents",
    "load_fitted": "files.models",
    "load_mat": "files.exchange.mat",
    "load_measured_modes": "files.measured_modes",
    "load_model": "files.models",
    "load_record": "files.records",
    "load_records": "files.records",
    "load_response": "files.records",
    "load_structure": "files.documents",
    "load_study": "files.studies",
    "margins_table": "control.analysis.margins_table",
    "matrix_zeros": "identification.plants.zeros",
    "measure_control_rms": "control.performance",
    "measure_delayed_rms": "control.analysis.delayed_rms",
    "measure_disk_margin": "control.analysis.disk",
    "measure_effective_mass": "structure.correlation.effective_mass",
    "measure_margins": "control.analysis.margins",
    "measure_metric": "control.performance",
    "measure_modes": "structure.correlation.measured_modes",
    "measure_rms": "control.performance",
    "measure_sampled_disk": "control.sampled.margins",
    "measure_sampled_loop": "control.sampled.outcome",
    "measure_sampled_margins": "control.sampled.margins",
    "measured_plant": "identification.plants.measured_plant",
    "merge_delays": "identification.plants.delays",
    "minimal_model": "identification.plants.reduction",
    "modal_parameters": "identification.plants.modal_parameters",
    "model_response": "identification.measurement_model",
    "multiple_coherence": "identification.spectra.coherence",
    "name_columns": "files.records.columns",
    "name_zeros": "identification.plants.zeros",
    "nearest_modes": "realtime.drift",
    "notch": "control.shaping.sections",
    "nrmse": "identification.simulation",
    "open_record": "files.records",
    "ordinary_coherence": "identification.spectra.coherence",
    "parameters_of": "identification.uncertainty.parameters",
    "partial_coherence": "identification.spectra.coherence",
    "path_zeros": "identification.plants.zeros",
    "peak_gain": "systems.peak_gain",
    "periods_needed": "identification.uncertainty.accuracy",
    "plant_as_sampled": "control.robust.sampled_plant",
    "pole_zero_gain": "identification.plants.pole_zero_gain",
    "qualify_compensator": "control.qualification",
    "read_record": "files.records",
    "recognise_excitation": "systems.excitation.recognition",
    "record_nrmse": "identification.samples.simulation",
    "reduce_compensator": "control.reduction.compensators",
    "reduce_modes": "control.reduction.modal",
    "reduce_plant": "control.reduction.plants",
    "response_bounds": "identification.uncertainty.response_bounds",
    "response_scatter": "identification.spectra.estimate",
    "roll_off": "control.shaping.sections",
    "run_hardware_closed_loop": "realtime.hardware_runs",
    "run_hardware_open_loop": "realtime.hardware_runs",
    "run_nonlinear_open_loop": "realtime.nonlinear_rig",
    "sample_models": "identification.uncertainty.model_set",
    "sampled_plant": "identification.plants.measured_plant",
    "sampling_table": "control.sampled.sampling_table",
    "scale_channels": "identification.plants.selection",
    "second_order_section": "control.shaping.sections",
    "select_channels": "identification.plants.selection",
    "shape_compensator": "control.shaping.sections",
    "simulate_record": "identification.samples.simulation",
    "simultaneous_bounds": "identification.uncertainty.response_bounds",
    "solve_discrete_riccati": "control.riccati.discrete",
    "solve_equilibrium": "structure.equilibrium",
    "solve_modes": "structure.modes",
    "solve_riccati": "control.riccati.continuous",
    "spectra_response": "identification.spectra.ratios",
    "split_periods": "files.records.together",
    "stabilisation": "identification.fit.stabilisation",
    "start_tracking": "identification.tracking.follow",
    "sum_spectra": "control.lqg.spectra",
    "summarise": "structure.checks.summary",
    "sweep_amplitude": "structure.gimbals.amplitude",
    "sweep_authority": "control.authority",
    "sweep_device_amplitude": "structure.suspension.device_friction",
    "sweep_gimbals": "structure.gimbals.family",
    "tilt_place": "structure.gravity.places",
    "to_control": "files.exchange.python_control",
    "to_scipy": "files.exchange.scipy_signal",
    "trace_return_ratio": "control.analysis.return_ratio",
    "track_modes": "identification.tracking.history",
    "tustin": "systems.sampling",
    "update_tracking": "identification.tracking.update",
    "verify_robustness": "control.robust.monte_carlo",
    "write_compensator": "files.compensators",
    "write_mat": "files.exchange.mat",
    "write_measured_modes": "files.measured_modes",
    "write_model": "files.models",
    "write_record": "files.records",
    "write_response": "files.records",
    "write_stream": "files.records",
}

__all__ = [
    "AnchoredSpring",
    "Campaign",
    "Channel",
    "Damping",
    "Deadband",
    "DelayedPlant",
    "Device",
    "DeviceKind",
    "Drift",
    "Encoder",
    "Environment",
    "Excitation",
    "Friction",
    "Gyro",
    "LQGWeights",
    "Limits",
    "MeasuredModes",
    "MeasurementModel",
    "MeasurementNoise",
    "MiddeckError",
    "ModeShift",
    "Motor",
    "PDLoops",
    "Performance",
    "PointingWindow",
    "Port",
    "Record",
    "RecordStream",
    "Reduction",
    "SampledCompensator",
    "Shaping",
    "StopRule",
    "Structure",
    "Suspension",
    "Uncertainty",
    "__version__",
    "accelerometer_offset",
    "age_plant",
    "approximate_delays",
    "as_compensator",
    "as_plant",
    "budget_pointing",
    "build_budget",
    "build_hardware_rig",
    "build_nonlinear_rig",
    "build_plant",
    "build_sampled_plant",
    "close_inner_loop",
    "close_loop",
    "colour_disturbances",
    "compare_designs",
    "compare_fits",
    "compare_modes",
    "compare_responses",
    "compare_sampling",
    "compare_static_gain",
    "compare_topologies",
    "comparison_table",
    "correlate_modes",
    "cut_periods",
    "decide_stability",
    "delay_inputs",
    "delayed_plant",
    "design_binary",
    "design_burst",
    "design_filter",
    "design_for_worst",
    "design_levels",
    "design_lqg",
    "design_mls",
    "design_multimodel",
    "design_multisine",
    "design_noise",
    "design_pd",
    "design_popov",
    "design_sampled_lqg",
    "design_sensitivity_weighted",
    "design_stepped_sine",
    "design_sweep",
    "detect_faults",
    "differentiate_frequencies",
    "differentiate_modes",
    "differentiate_plant",
    "differentiate_rest",
    "draw_positions",
    "emulate",
    "estimate_attitude",
    "estimate_damping",
    "estimate_distortion",
    "estimate_response",
    "estimate_rest_band",
    "estimate_spectra",
    "evaluate_plant",
    "expected_accuracy",
    "filter_measurements",
    "find_aliases",
    "find_allowed_shifts",
    "find_first_instability",
    "find_inversion",
    "find_parameters",
    "find_participation",
    "find_participations",
    "find_place",
    "find_profile",
    "find_sampled_shifts",
    "find_worst_case",
    "first_order_section",
    "fit_record",
    "fit_response",
    "fit_spectrum",
    "follow_gravity",
    "from_control",
    "from_pole_zero_gain",
    "from_scipy",
    "leave_open",
    "level",
    "line_filter",
    "list_parameters",
    "load_campaign",
    "load_case",
    "load_compensator",
    "load_environment",
    "load_fitted",
    "load_mat",
    "load_measured_modes",
    "load_model",
    "load_record",
    "load_records",
    "load_response",
    "load_structure",
    "load_study",
    "margins_table",
    "matrix_zeros",
    "measure_control_rms",
    "measure_delayed_rms",
    "measure_disk_margin",
    "measure_effective_mass",
    "measure_margins",
    "measure_metric",
    "measure_modes",
    "measure_rms",
    "measure_sampled_disk",
    "measure_sampled_loop",
    "measure_sampled_margins",
    "measured_plant",
    "merge_delays",
    "minimal_model",
    "modal_parameters",
    "model_response",
    "multiple_coherence",
    "name_columns",
    "name_zeros",
    "nearest_modes",
    "notch",
    "nrmse",
    "open_record",
    "ordinary_coherence",
    "parameters_of",
    "partial_coherence",
    "path_zeros",
    "peak_gain",
    "periods_needed",
    "plant_as_sampled",
    "pole_zero_gain",
    "qualify_compensator",
    "read_record",
    "recognise_excitation",
    "record_nrmse",
    "reduce_compensator",
    "reduce_modes",
    "reduce_plant",
    "response_bounds",
    "response_scatter",
    "roll_off",
    "run_hardware_closed_loop",
    "run_hardware_open_loop",
    "run_nonlinear_open_loop",
    "sample_models",
    "sampled_plant",
    "sampling_table",
    "scale_channels",
    "second_order_section",
    "select_channels",
    "shape_compensator",
    "simulate_record",
    "simultaneous_bounds",
    "solve_discrete_riccati",
    "solve_equilibrium",
    "solve_modes",
    "solve_riccati",
    "spectra_response",
    "split_periods",
    "stabilisation",
    "start_tracking",
    "sum_spectra",
    "summarise",
    "sweep_amplitude",
    "sweep_authority",
    "sweep_device_amplitude",
    "sweep_gimbals",
    "tilt_place",
    "to_control",
    "to_scipy",
    "trace_return_ratio",
    "track_modes",
    "tustin",
    "update_tracking",
    "verify_robustness",
    "write_compensator",
    "write_mat",
    "write_measured_modes",
    "write_model",
    "write_record",
    "write_response",
    "write_stream",
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
