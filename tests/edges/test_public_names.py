"""``import middeck``: light, typed, and exactly the names that are documented."""

from __future__ import annotations

import ast
import subprocess
import sys
from pathlib import Path

import pytest

import middeck

# The names that CHANGELOG and README may rely on; a change here is a change of the public interface.
DOCUMENTED = [
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


def test_the_names_are_those_documented() -> None:
    assert sorted(middeck.__all__) == sorted(DOCUMENTED) == dir(middeck)


@pytest.mark.parametrize("name", DOCUMENTED)
def test_each_name_resolves_to_itself_and_says_what_it_is(name: str) -> None:
    value = getattr(middeck, name)
    if name != "__version__":
        assert value.__name__ == name
        assert value.__doc__


def test_checkers_see_each_name_where_it_is_loaded_from() -> None:
    tree = ast.parse(Path(middeck.__file__).read_text(encoding="utf-8"))
    block = next(n for n in tree.body if isinstance(n, ast.If))
    seen = {
        alias.name: line.module
        for line in block.body
        if isinstance(line, ast.ImportFrom)
        for alias in line.names
    }
    assert seen == {n: getattr(middeck, n).__module__ for n in DOCUMENTED if n != "__version__"}


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="no attribute 'solve_mode'"):
        middeck.solve_mode  # noqa: B018


def test_import_alone_loads_no_library() -> None:
    code = (
        "import middeck, sys; print([m for m in ('numpy', 'scipy', 'click', 'pydantic') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout == "[]\n"
