"""Any value to a file: its kind finds the writer, the ending of the file the form."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

from middeck.arguments import named_kinds
from middeck.control.law.compensator import Compensator
from middeck.errors import ConfigError
from middeck.files.articles.components import write_component
from middeck.files.exchange.matlab_systems import write_mat
from middeck.files.exchange.vtu import write_vtu
from middeck.files.laws.compensators import write_compensator
from middeck.files.laws.packages import write_package
from middeck.files.measured.models import write_mat_model, write_model
from middeck.files.measured.modes import write_measured_modes
from middeck.files.records import write_record, write_response
from middeck.identification.fit.fit_response import FitResult
from middeck.identification.model.measurement_model import MeasurementModel
from middeck.realtime.package.package import ControllerPackage
from middeck.signals.record import Record
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.structure.model.component import Component
from middeck.structure.modes.results.article_drawing import Drawing
from middeck.systems.plants.plant import Plant
from middeck.systems.plants.response import FrequencyResponse
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace


@named_kinds
def write(path: str | Path, value: object) -> None:
    """Write ``value`` to ``path`` whole or not at all; `load_record` and its like read it back.

    A `Record` goes to .npz, .h5, .csv, .mat or .uff, a `FrequencyResponse` to .uff; a `MeasurementModel`, or
    a whole fit with its covariance and the standing of its modes, to .json (as a state space to .mat);
    `MeasuredModes` to .json or .unv; a `Compensator` to .json or .mat, a `Plant` or state space to .mat; a
    `ControllerPackage` to .mdk, .json, .c with its header or .h; a component to .npz or .mat, a drawing to
    .vtu.

    Raises `ConfigError` for another kind of value, for both arguments swapped, and for an ending that its
    writer does not know.
    """
    for kind, writer in WRITERS.items():
        if isinstance(value, kind):
            writer(path, value)
            return
    if isinstance(path, tuple(WRITERS)):
        what = f"a {type(path).__name__} stands where the path belongs"
        raise ConfigError(what, where="write", hint="write(path, value)")
    kinds = ", ".join(kind.__name__ for kind in WRITERS)
    raise ConfigError(f"no file holds a {type(value).__name__}", where=str(path), hint=f"one of {kinds}")


def is_mat(path: str | Path) -> bool:
    """Whether a file is MATLAB's by its name."""
    return Path(path).suffix.lower() == ".mat"


def _to_mat(path: str | Path, value: object) -> bool:
    """Whether to write a MAT file, not JSON; raises `ConfigError` for any ending but .json and .mat."""
    ending = Path(path).suffix
    if ending.lower() not in (".json", ".mat"):
        what = f"no writer for a {type(value).__name__} in {ending!r} files"
        raise ConfigError(what, where=str(path), hint="name it .json or .mat")
    return is_mat(path)


def _law(path: str | Path, law: Compensator) -> None:
    (write_mat if _to_mat(path, law) else write_compensator)(path, law)


def _model(path: str | Path, model: MeasurementModel) -> None:
    (write_mat_model if _to_mat(path, model) else write_model)(path, model)


def _fit(path: str | Path, fit: FitResult) -> None:
    if _to_mat(path, fit):
        write_mat_model(path, fit.model)
    else:
        write_model(path, fit.model, fit.covariance, fit.standing)


def _system(path: str | Path, system: Plant | StateSpace | SampledStateSpace) -> None:
    if not is_mat(path):
        what = f"no writer for a {type(system).__name__} in {Path(path).suffix!r} files"
        raise ConfigError(what, where=str(path), hint="name it .mat")
    write_mat(path, system)


WRITERS: dict[type, Callable[[str | Path, Any], object]] = {
    Record: write_record,
    FrequencyResponse: write_response,
    FitResult: _fit,
    MeasurementModel: _model,
    MeasuredModes: write_measured_modes,
    Compensator: _law,
    Plant: _system,
    StateSpace: _system,
    SampledStateSpace: _system,
    ControllerPackage: write_package,
    Component: write_component,
    Drawing: write_vtu,
}
