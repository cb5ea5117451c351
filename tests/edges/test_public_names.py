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
    "sweep_authority",
    "write_compensator",
    "write_model",
    "split_periods",
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
