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
