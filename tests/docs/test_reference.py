"""The reference names all there is and nothing else."""

from __future__ import annotations

import dataclasses
import pkgutil
import re
import sys
from types import ModuleType

import pytest
from doc_pages import ROOT, rows
from pydantic_core import PydanticUndefined

import middeck
from middeck import errors
from middeck.cli import main as console
from middeck.cli.app import VERBS, app
from middeck.files.articles import boundary_form, link_form
from middeck.files.articles import form as article_form
from middeck.files.environments import form as environment_form
from middeck.files.promises import outcomes
from middeck.files.promises import plans as promise_plans
from middeck.files.refinements import candidate_documents as candidate_files
from middeck.files.refinements import documents as refinements
from middeck.files.refinements import friction_form, gauge_form, promised_loads, response_form, unknown_form
from middeck.files.studies import form as study_form
from middeck.files.studies import promise_table as study_promise
from middeck.files.toml.form import Form, unit_of
from middeck.realtime.engine.interface.shared_file import record_type
from middeck.realtime.engine.recording.run_file import Run

REFERENCE = ROOT / "docs" / "reference"

# The tables of files.md, in its order.
FORMS: list[type[Form]] = [
    article_form.ArticleForm,
    article_form.MeshForm,
    article_form.MaterialForm,
    article_form.SectionForm,
    article_form.NodeForm,
    article_form.StrutForm,
    article_form.StationForm,
    article_form.GimbalForm,
    article_form.RevoluteForm,
    article_form.ProofMassForm,
    article_form.WheelForm,
    article_form.AttachForm,
    article_form.SuspensionForm,
    article_form.SpringForm,
    boundary_form.BushingForm,
    link_form.LinkForm,
    link_form.InterpolationForm,
    link_form.ShareForm,
    link_form.EquationForm,
    link_form.TermForm,
    article_form.ComponentForm,
    article_form.ActuatorForm,
    article_form.SensorForm,
    article_form.DampingForm,
    article_form.DamperForm,
    article_form.DampingTableForm,
    boundary_form.LoadCaseForm,
    boundary_form.LoadForm,
    boundary_form.MassForm,
    boundary_form.PrescribedForm,
    environment_form.EnvironmentForm,
    environment_form.ConstantsForm,
    environment_form.CablesForm,
    environment_form.DeviceForm,
    environment_form.AnchoredSpringForm,
    boundary_form.ClampForm,
    boundary_form.GroundBushingForm,
    study_form.StudyForm,
    study_form.ControlForm,
    study_form.RigForm,
    study_form.Figure6Form,
    study_form.SisoForm,
    study_form.AuthorityForm,
    study_form.ImprovementForm,
    study_form.SitoForm,
    study_promise.PromiseForm,
    study_promise.SetUpForm,
    study_form.MirrorForm,
    refinements.RefinementForm,
    refinements.SurveyForm,
    friction_form.FrictionForm,
    friction_form.AmplitudeForm,
    response_form.ResponseForm,
    response_form.AntiResonanceForm,
    gauge_form.StaticForm,
    gauge_form.GaugeForm,
    gauge_form.ReadingForm,
    unknown_form.UnknownForm,
    candidate_files.CandidatesForm,
    candidate_files.CandidateForm,
    gauge_form.PlannedStaticForm,
    promise_plans.PlanForm,
    promise_plans.PerformanceForm,
    promise_plans.NoiseForm,
    promise_plans.LoopForm,
    promise_plans.InnerForm,
    promise_plans.LadderForm,
    promise_plans.LawFile,
    promise_plans.JointForm,
    promise_plans.SweepForm,
    promised_loads.PromisedLoadsForm,
    outcomes.OutcomeForm,
    outcomes.ModeOutcomeForm,
    outcomes.SurveyOutcomeForm,
    outcomes.LoopOutcomeForm,
    outcomes.ReadingOutcomeForm,
]


def test_every_public_name_is_listed_and_fresh(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_api_reference

    try:
        assert make_api_reference.main(["--check"]) == 0, "run docs/make_api_reference.py"
    finally:
        sys.modules.pop("make_api_reference")
    listed = {row[0].strip("`").partition("(")[0] for row in rows(REFERENCE / "api.md")}
    rooms = {name for name in middeck.__all__ if isinstance(getattr(middeck, name), ModuleType)}
    of_rooms = {f"{room}.{name}" for room in rooms for name in getattr(middeck, room).__all__}
    assert listed == set(middeck.__all__) - rooms | of_rooms


def test_what_the_paper_page_names_can_be_imported():
    functions = [row[2] for row in rows(ROOT / "docs" / "paper.md")]
    named = [name for cell in functions for name in re.findall(r"`([a-z_.0-9]+)`", cell)]
    assert named
    for name in named:
        assert pkgutil.resolve_name(f"middeck.{name}") is not None


def test_every_form_has_its_table():
    """So that a form added later cannot be forgotten here."""
    forms = (article_form, boundary_form, environment_form, link_form)
    studies = study_form, study_promise
    modules = (
        *forms,
        *studies,
        friction_form,
        gauge_form,
        refinements,
        response_form,
        unknown_form,
        candidate_files,
        promise_plans,
        promised_loads,
        outcomes,
    )
    defined = {
        x for m in modules for x in vars(m).values() if isinstance(x, type) and x.__module__ == m.__name__
    }
    # What forms have in common is no table of a file.
    tables = {x for x in defined if issubclass(x, Form) and not x.__name__.startswith("_")}
    assert tables - {boundary_form.AxesForm} == set(FORMS)


def _tables() -> list[list[list[str]]]:
    """Rows of files.md, table by table."""
    tables: list[list[list[str]]] = []
    text = (REFERENCE / "files.md").read_text(encoding="utf-8")
    for part in text.split("| key | unit | default | meaning |\n")[1:]:
        body = part.split("\n\n")[0].splitlines()[1:]
        tables.append([[c.strip() for c in line.strip("|").split("|")] for line in body])
    return tables


@pytest.mark.parametrize(
    ("form", "table"), list(zip(FORMS, _tables(), strict=True)), ids=lambda x: getattr(x, "__name__", "")
)
def test_every_key_of_a_file_is_listed_with_its_unit_and_default(form: type[Form], table: list[list[str]]):
    listed = {row[0].strip("`"): (row[1], row[2]) for row in table}
    actual = {}
    for name, field in form.model_fields.items():
        key = field.alias or name
        actual[key] = (unit_of(key), _default(field))
    assert listed == actual


def _default(field) -> str:
    """As the page writes it: in TOML, or nothing where there is no plain default."""
    if field.is_required():
        return "required"
    value = None if field.default is PydanticUndefined else field.default
    match value:
        case bool():
            return f"`{str(value).lower()}`"
        case int() | float():
            return f"`{value}`"
        case tuple() if value:
            return f"`{list(value)}`"
        case str() if value:
            return f"`{value}`"
    return ""


def test_every_field_of_a_run_is_listed():
    text = (REFERENCE / "files.md").read_text(encoding="utf-8").split("### Runs of an engine")[1]
    table = text.split("| field | unit | meaning |\n")[1].split("\n\n")[0].splitlines()[1:]
    listed = [name for line in table for name in re.findall(r"`(\w+)`", line.split("|")[1])]
    assert sorted(listed) == sorted(record_type(1, 1).names)
    missing = {f.name for f in dataclasses.fields(Run)} & {"records", "events", "faults", "states"}
    assert all(f"`{name}`" in text or f"Run.{name}" in text for name in missing)


def test_every_error_and_exit_code_is_listed():
    listed = {(int(row[0]), row[1].strip("`")) for row in rows(REFERENCE / "errors.md")}
    classes = [x for x in vars(errors).values() if isinstance(x, type) and issubclass(x, errors.MiddeckError)]
    assert {pair for pair in listed if pair[1]} == {(c.exit_code, c.__name__) for c in classes}
    documented = {int(code) for code in re.findall(r"^\s*(\d+) \S", console.__doc__ or "", re.MULTILINE)}
    assert (
        {code for code, _ in listed} == documented == {0, *range(1, 6), console.INTERNAL, console.INTERRUPTED}
    )


def test_every_verb_is_documented_and_fresh(monkeypatch: pytest.MonkeyPatch):
    monkeypatch.syspath_prepend(str(ROOT / "docs"))
    import make_cli_reference

    try:
        assert make_cli_reference.main(["--check"]) == 0, "run docs/make_cli_reference.py"
    finally:
        sys.modules.pop("make_cli_reference")
    text = (REFERENCE / "cli.md").read_text(encoding="utf-8")
    assert re.findall(r"^## middeck (\S+)$", text, re.MULTILINE) == list(VERBS)


def test_the_page_of_pictures_names_the_verbs_that_draw():
    """Above its pictures, and all but those of shapes in its table of figures."""
    draws = {name for name in VERBS for part in app.get_command(None, name).params if "--figure" in part.opts}
    page = ROOT / "docs/how-to/see-the-shapes.md"
    told = page.read_text(encoding="utf-8").split("The ending")[0]
    assert set(re.findall(r"`(\w+)`", told)) == draws
    listed = {name for row in rows(page) for name in re.findall(r"`(\w+)`", row[0])}
    assert listed == draws - {"modes", "compare"}
