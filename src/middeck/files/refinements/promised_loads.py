"""Load cases to be promised: gauge readings under untested loads."""

from pathlib import Path
from typing import Annotated, Literal

from pydantic import Field

from middeck.errors import ConfigError
from middeck.files.articles.boundary_form import LoadCaseForm, build_load_cases
from middeck.files.disk.kind_of_content import LOADS
from middeck.files.refinements.documents import Refinement, load_refinement
from middeck.files.refinements.gauge_form import (
    NOTHING,
    ONE_OF_EACH,
    GaugeForm,
    build_gauge,
    promised_findings,
)
from middeck.files.setups import article_files, find_stated, load_setup, load_structure
from middeck.files.toml.form import Form, whole
from middeck.files.toml.source import read_form
from middeck.structure.model.article import LoadCase, Structure
from middeck.structure.model.environment import Environment
from middeck.updating.orbit.deflections import Deflection, predict_deflections
from middeck.updating.refinement.refine import Refined
from middeck.updating.residuals.gauges import Gauge
from middeck.values import record


class PromisedLoadsForm(Form):
    """Load cases, and what reads them."""

    schema_: Literal["middeck.promised-loads/1"] = Field(alias="schema")
    refinement: str
    environment: str = "lab"
    since: Literal["unloaded", "drawn"] = "unloaded"
    series: str = ""
    modes: Annotated[int, whole(0, 10000)] = 0
    load_case: Annotated[tuple[LoadCaseForm, ...], Field(strict=False)] = ()
    gauge: Annotated[tuple[GaugeForm, ...], Field(strict=False)] = ()


@record(kw_only=True)
class PromisedLoads:
    """An article, its refinement, and the quantities promised at rest.

    Attributes:
        environment_name: Name of the environment in the document.
        modes: Number of lowest modes promised beside the readings.
        files: Every file that was read.
    """

    structure: Structure
    refinement: Refinement
    environment_name: str
    environment: Environment
    load_cases: tuple[LoadCase, ...]
    gauges: tuple[Gauge, ...]
    since_unloaded: bool
    series: str
    modes: int
    files: tuple[Path, ...]

    def require_some(self) -> None:
        """Raise `ConfigError` where neither readings nor modes are promised."""
        if not (self.load_cases or self.modes):
            raise ConfigError(NOTHING, where=str(self.files[0]), hint=ONE_OF_EACH)

    def of(self, refined: Refined) -> tuple[Deflection, ...]:
        """Gauge readings to be promised for the refined article."""
        return predict_deflections(
            refined, self.environment, self.load_cases, self.gauges,
            since_unloaded=self.since_unloaded, series=self.series,
        )  # fmt: skip


def load_promised_loads(path: str | Path, article: str | Path) -> PromisedLoads:
    """The load cases in file ``path`` for the article in file ``article``.

    The refinement is sought beside it. Raises `ConfigError` with all faults of the document.
    """
    form = read_form(path, LOADS, PromisedLoadsForm, promised_findings)
    place = find_stated(form.environment, path)
    refinement = load_refinement(Path(path).parent / form.refinement, article)
    return PromisedLoads(
        structure=load_structure(article),
        refinement=refinement,
        environment_name=form.environment,
        environment=load_setup(article, place)[1],
        load_cases=build_load_cases(form.load_case),
        gauges=tuple(build_gauge(gauge) for gauge in form.gauge),
        since_unloaded=form.since == "unloaded",
        series=form.series,
        modes=form.modes,
        files=tuple(dict.fromkeys((Path(path), *article_files(article), *refinement.files, place))),
    )
