"""Documents of candidates: tests that may be made of an article, and its promised quantities."""

from functools import partial
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import Field

from middeck.errors import ConfigError
from middeck.files.disk.kind_of_content import CANDIDATES
from middeck.files.refinements.documents import Refinement, load_refinement
from middeck.files.refinements.gauge_form import PLANNED, PlannedStaticForm, build_static, static_findings
from middeck.files.refinements.promised_loads import PromisedLoads, load_promised_loads
from middeck.files.setups import find_stated, load_setup, load_structure
from middeck.files.toml.form import Finite, Form, NotNegative, Positive, rule, whole
from middeck.files.toml.source import read_form
from middeck.structure.correlation.measured_modes import COUNT, DIRECTIONS
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.updating.candidates.candidate_survey import CandidateSurvey
from middeck.updating.residuals.static_tests import StaticTest
from middeck.updating.residuals.surveys import SHAPE_STD
from middeck.values import record

Channel = Annotated[
    str,
    rule(
        lambda text: text.rpartition(" ")[2] in DIRECTIONS,
        "is no channel",
        f'a name and a direction, as "n1 x": {", ".join(DIRECTIONS)}',
    ),
]


class CandidateForm(Form):
    """A candidate modal test: a survey without its modes, and the deviations that it would have."""

    name: str
    environment: str = "lab"
    set: dict[str, Finite] = Field(default_factory=dict)
    frequency_std: Positive
    shape_std: Positive = SHAPE_STD
    channels: Annotated[tuple[Channel, ...], Field(strict=False)] | None = None
    count: Annotated[int, whole(1, 10000)] = COUNT
    band_hz: Annotated[tuple[NotNegative, Positive], Field(strict=False)] | None = None


class CandidatesForm(Form):
    """Candidate tests, the refinement that each adds to, and the promised quantities."""

    schema_: Literal["middeck.candidates/1"] = Field(alias="schema")
    refinement: str
    environments: Annotated[tuple[str, ...], Field(strict=False)] = ("orbit",)
    modes: Annotated[int, whole(1, 10000)] = 10
    promised_loads: str | None = None
    survey: Annotated[tuple[CandidateForm, ...], Field(strict=False)] = ()
    static: Annotated[tuple[PlannedStaticForm, ...], Field(strict=False)] = ()


@record(kw_only=True)
class RankedTests:
    """The arguments of `rank_tests` (`updating.candidates.rank_tests`), an article and its refinement.

    Attributes:
        environments: Environments in which frequencies are promised, by name.
        modes: Number of lowest modes promised in each.
        loads: Promised gauge readings.
    """

    structure: Structure
    refinement: Refinement
    environments: dict[str, Environment]
    modes: int
    loads: PromisedLoads | None
    tests: tuple[CandidateSurvey | StaticTest, ...]


def load_candidates(path: str | Path, article: str | Path) -> RankedTests:
    """The candidates in file ``path`` for the article in file ``article``.

    The refinement is sought beside it, environments as everywhere. Raises `ConfigError` with all faults of
    the document, and for environments given twice.
    """
    form = read_form(path, CANDIDATES, CandidatesForm, partial(static_findings, stated=PLANNED))
    twice = [name for name in form.environments if form.environments.count(name) > 1]
    if twice:
        raise ConfigError(
            f"the name {twice[0]!r} is given twice", where=f"{path}, environment", hint="each once"
        )

    refined_on = Path(path).parent / form.refinement
    loads = None if form.promised_loads is None else Path(path).parent / form.promised_loads

    def there(name: str) -> Environment:
        return load_setup(article, find_stated(name, path))[1]

    return RankedTests(
        structure=load_structure(article),
        refinement=load_refinement(refined_on, article),
        environments={name: there(name) for name in form.environments},
        modes=form.modes,
        loads=None if loads is None else _loads(loads, article, refined_on),
        tests=(
            *(_survey(s, there(s.environment)) for s in form.survey),
            *(build_static(s, there(s.environment), np.zeros(len(s.reading))) for s in form.static),
        ),
    )


def _loads(path: Path, article: str | Path, refined_on: Path) -> PromisedLoads:
    """Load cases that are promised. Raises `ConfigError` where they stand on another refinement."""
    found = load_promised_loads(path, article)
    if found.refinement.files[0].resolve() != refined_on.resolve():
        raise ConfigError(
            f"promised on {found.refinement.files[0]}, not on {refined_on}",
            where=str(path),
            hint="one refinement for what is promised and for the candidates",
        )
    return found


def _survey(form: CandidateForm, environment: Environment) -> CandidateSurvey:
    return CandidateSurvey(
        name=form.name,
        environment=environment,
        settings=tuple(form.set.items()),
        frequency_std=form.frequency_std,
        shape_std=form.shape_std,
        channels=None if form.channels is None else tuple(_channel(c) for c in form.channels),
        count=form.count,
        band_hz=form.band_hz or (0.0, np.inf),
    )


def _channel(text: str) -> tuple[str, str]:
    name, _, direction = text.rpartition(" ")
    return name.strip(), direction
