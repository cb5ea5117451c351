"""Documents of a refinement: tests on the ground and unknowns; refined articles."""

import re
from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from middeck.errors import DataError
from middeck.files.disk.kind_of_content import ARTICLE, REFINEMENT, SCHEMAS, looks_like
from middeck.files.measured.models import load_fitted, load_standing
from middeck.files.measured.modes import load_measured_modes
from middeck.files.refinements.friction_form import (
    AmplitudeForm,
    FrictionForm,
    build_frictions,
    friction_findings,
    refuse_slides,
)
from middeck.files.refinements.gauge_form import (
    StaticForm,
    build_static,
    static_findings,
    value_of,
)
from middeck.files.refinements.loading_form import LoadingForm, case_of, survey_load_findings
from middeck.files.refinements.response_form import AntiResonanceForm, ResponseForm, build_response
from middeck.files.refinements.unknown_form import UnknownForm
from middeck.files.setups import find_stated, load_setup, load_structure
from middeck.files.toml.faults import PathFault
from middeck.files.toml.form import Finite, Form, Positive
from middeck.files.toml.source import read_form, read_source
from middeck.structure.correlation.measured_modes import MeasuredModes
from middeck.updating.refinement.bayesian_estimate import USUAL
from middeck.updating.refinement.refine import USUAL_DAMPING, USUAL_STATIC
from middeck.updating.residuals.fitted_survey import survey_from_fit
from middeck.updating.residuals.static_tests import StaticTest
from middeck.updating.residuals.surveys import Survey
from middeck.updating.unknowns.unknowns import Unknown
from middeck.values import record

# A table of the file, from its head to that of the next one or the end.
FACTORS = re.compile(r"(?ms)^\s*\[factors\].*?(?=^\s*\[|\Z)")


class SurveyForm(LoadingForm):
    """Modes measured in one set-up; ``set`` has the parameters set by the test, by name."""

    modes: str
    environment: str = "lab"
    frequency_std: Positive | None = None
    damping_std: Positive | None = None
    set: dict[str, Finite] = Field(default_factory=dict)
    amplitude: Annotated[tuple[AmplitudeForm, ...], Field(strict=False)] = ()
    response: ResponseForm | None = None
    anti_resonance: Annotated[tuple[AntiResonanceForm, ...], Field(strict=False)] = ()


class RefinementForm(Form):
    """A refinement of an article."""

    schema_: Literal["middeck.refinement/1"] = Field(alias="schema")
    model_error: Positive = USUAL
    static_error: Positive = USUAL_STATIC
    damping_error: Positive = USUAL_DAMPING
    survey: Annotated[tuple[SurveyForm, ...], Field(strict=False)] = ()
    static: Annotated[tuple[StaticForm, ...], Field(strict=False)] = ()
    friction: Annotated[tuple[FrictionForm, ...], Field(strict=False)] = ()
    unknown: Annotated[tuple[UnknownForm, ...], Field(strict=False, min_length=1)]


@record(kw_only=True)
class Refinement:
    """The arguments of `middeck.updating.refinement.refine` beside an article, and every file behind them."""

    surveys: tuple[Survey, ...]
    unknowns: tuple[Unknown, ...]
    model_error: float
    statics: tuple[StaticTest, ...]
    static_error: float
    damping_error: float
    files: tuple[Path, ...]

    @property
    def of_refine(
        self,
    ) -> tuple[tuple[Survey, ...], tuple[Unknown, ...], float, tuple[StaticTest, ...], float, float]:
        """Arguments of `refine` and `weigh_unknowns` after the article."""
        errors = self.static_error, self.damping_error
        return self.surveys, self.unknowns, self.model_error, self.statics, *errors


def load_refinement(path: str | Path, article: str | Path) -> Refinement:
    """The refinement in file ``path`` of the article in file ``article``.

    Files of modes are sought beside it, environments as everywhere. Raises `ConfigError` with all faults of
    the document, and `DataError` for modes that cannot be read.
    """
    form = read_form(path, REFINEMENT, RefinementForm, _findings)
    refuse_slides(load_structure(article), [f.joint for f in form.friction], f"{path}, friction")
    modes = [Path(path).parent / s.modes for s in form.survey]
    measured = [load_survey_modes(seen, article) for seen in modes]
    environments = [find_stated(s.environment, path) for s in form.survey]
    rests = [find_stated(t.environment, path) for t in form.static]
    surveys = tuple(
        Survey(
            name=s.name,
            measured=seen,
            environment=load_setup(article, place)[1],
            settings=tuple(s.set.items()),
            load_case=case_of(s),
            frequency_std=s.frequency_std,
            damping_std=s.damping_std,
            response=build_response(s.response, s.anti_resonance, Path(path).parent),
            friction=build_frictions(s.amplitude, form.friction, len(seen.frequency_hz)),
        )
        for s, seen, place in zip(form.survey, measured, environments, strict=True)
    )
    statics = tuple(
        build_static(t, load_setup(article, place)[1], [value_of(r) for r in t.reading])
        for t, place in zip(form.static, rests, strict=True)
    )
    unknowns = tuple(build_unknown(u) for u in form.unknown)
    responses = [Path(path).parent / s.response.file for s in form.survey if s.response is not None]
    files = dict.fromkeys((Path(path), *modes, *responses, *environments, *rests))
    return Refinement(
        surveys=surveys,
        unknowns=unknowns,
        model_error=form.model_error,
        statics=statics,
        static_error=form.static_error,
        damping_error=form.damping_error,
        files=tuple(files),
    )


def _findings(data: Any) -> list[PathFault]:
    return [*survey_load_findings(data), *static_findings(data), *friction_findings(data)]


def build_unknown(form: UnknownForm) -> Unknown:
    """The unknown that ``form`` states."""
    return Unknown(**form.model_dump())


def refined_text(article: str | Path, factors: Mapping[str, float]) -> str:
    """The article's file with ``factors`` beside those that it had: they multiply."""
    text = Path(article).read_text(encoding="utf-8")
    had: dict[str, float] = read_source(article, ARTICLE).data.get("factors", {})
    names = dict.fromkeys([*had, *factors])
    lines = [f'"{n}" = {float(had.get(n, 1.0) * factors.get(n, 1.0))!r}' for n in names]
    return FACTORS.sub("", text).rstrip() + "\n\n[factors]\n" + "\n".join(lines) + "\n"


def load_survey_modes(path: str | Path, article: str | Path) -> MeasuredModes:
    """Measured modes, or those of a fitted model whose ports are sensors and actuators of ``article``.

    Raises as `load_measured_modes`, `load_fitted` and `survey_from_fit`, and `DataError` for a model without
    deviations.
    """
    if looks_like(path) != SCHEMAS["model"]:
        return load_measured_modes(path)
    _, covariance = load_fitted(path)
    if covariance is None:
        raise DataError(
            "the model has no covariance, so it cannot be a survey",
            where=str(path),
            hint="a model of middeck identify holds a covariance",
        )
    return survey_from_fit(load_structure(article), covariance, standing=load_standing(path))
