"""Read a study with the articles and environments it stands on."""

import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, TypeVar, cast

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.files.articles.checks import article_findings
from middeck.files.articles.form import ArticleForm
from middeck.files.articles.names import attach_names
from middeck.files.disk.digest import sha256_of
from middeck.files.disk.kind_of_content import STUDY
from middeck.files.environments.checks import environment_findings
from middeck.files.environments.form import EnvironmentForm, build_environment
from middeck.files.setups import article_files, build_article, join_findings, overridden
from middeck.files.studies import form as study_form
from middeck.files.studies.checks import fixed_axes, signal_findings
from middeck.files.studies.promise_table import PromiseForm
from middeck.files.studies.rig_table import build_loop_test, build_rig_settings
from middeck.files.toml.faults import DocumentFault, PathFault, finding, raise_faults
from middeck.files.toml.lines import Path as KeyPath
from middeck.files.toml.overrides import OverriddenDocument, apply_overrides
from middeck.files.toml.source import Checked, Kind, Source, place_in, read_source, read_sources
from middeck.laboratory.rig_settings import LoopTest, RigSettings
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.values import record

F = TypeVar("F")


@record
class StudyCase:
    """An article in an environment, both by their names in the study."""

    article: str
    environment: str
    structure: Structure
    surroundings: Environment


@record(kw_only=True)
class Study:
    """All that a study needs, read and checked.

    Attributes:
        form: The tables of the study file: attributes are its keys, units in their endings. Each table is a
            property of the study, too, which raises `ConfigError` where the file has none.
        folder: Folder of the study file; its paths are relative to it.
        cases: Every article in every environment; see `case`.
        inputs: Name (from the study's folder) and SHA-256 of every file that was read or is to be read.
        overrides: Overrides by ``--set``.
    """

    form: study_form.StudyForm
    folder: Path
    cases: tuple[StudyCase, ...]
    inputs: tuple[tuple[str, str], ...]
    overrides: tuple[str, ...]

    @property
    def title(self) -> str:
        """Heading of the report."""
        return self.form.title

    @property
    def seed(self) -> int:
        """Seed of all random numbers."""
        return self.form.seed

    @property
    def account(self) -> str | None:
        """Source of the report's claims; without one there are none."""
        return self.form.account

    @property
    def control(self) -> study_form.ControlForm:
        """Inner loops, LQG and the sweep of authority."""
        return _given(self.form.control, "control")

    @property
    def figure_6(self) -> study_form.Figure6Form:
        """One input to several outputs in both environments."""
        return _given(self.form.figure_6, "figure_6")

    @property
    def siso(self) -> study_form.SisoForm:
        """The measured loop."""
        return _given(self.form.siso, "siso")

    @property
    def sito(self) -> study_form.SitoForm:
        """The measured loop with two sensors."""
        return _given(self.form.sito, "sito")

    @property
    def promise(self) -> PromiseForm:
        """A ground test, and the promise made from it."""
        return _given(self.form.promise, "promise")

    @property
    def mirror(self) -> study_form.MirrorForm:
        """A measured record and one to judge its fit by."""
        return _given(self.form.mirror, "mirror")

    @property
    def rig(self) -> RigSettings:
        """The simulated rig."""
        return build_rig_settings(_given(self.form.rig, "rig"))

    @property
    def loop_test(self) -> LoopTest:
        """The experiments on the rig with the motor of ``siso``."""
        return build_loop_test(self.siso)

    def has(self, *tables: str) -> bool:
        """Whether the study file has all these tables."""
        return all(getattr(self.form, table) is not None for table in tables)

    def case(self, article: str, environment: str) -> tuple[Structure, Environment]:
        """The structure and environment of these names; raises `ConfigError` if the study has none."""
        for c in self.cases:
            if (c.article, c.environment) == (article, environment):
                return c.structure, c.surroundings
        articles = dict.fromkeys(c.article for c in self.cases)
        environments = dict.fromkeys(c.environment for c in self.cases)
        raise ConfigError(
            f"the study has no article {article!r} in an environment {environment!r}",
            hint=f"articles: {', '.join(articles)}; environments: {', '.join(environments)}",
        )


@named_kinds
def load_study(path: str | Path, overrides: Sequence[str] = ()) -> Study:
    """The study in file ``path`` with ``overrides``.

    Raises `ConfigError` with every fault of the study, its articles and its environments together.
    """
    source = read_source(path, STUDY)
    # The file names must be known, overridden or not, before the other documents can be overridden.
    (data,), (changed,) = apply_overrides(
        [OverriddenDocument(source.file, source.data, study_form.StudyForm)],
        [o for o in overrides if _is_reference(o)],
    )
    base = Path(path).parent
    _raise_missing(source, data, changed, base)
    names, files = _references(data, "article"), _references(data, "environment")
    kinds: list[Kind] = [*("article" for _ in names), *("environment" for _ in files)]
    sources = read_sources([base / p for _, p in (*names, *files)], kinds)
    articles = {name: s for (name, _), s in zip(names, sources, strict=False)}
    environments = {name: s for (name, _), s in zip(files, sources[len(names) :], strict=True)}
    study, structures, surroundings = _check(source, articles, environments, overrides)
    form = cast("study_form.StudyForm", study.form)
    records = [] if form.mirror is None else [base / form.mirror.train, base / form.mirror.test]
    bodies = [file for s in articles.values() for file in article_files(s.file)]
    files = [Path(path), *bodies, *(Path(s.file) for s in environments.values()), *records]
    built = {name: build_article(c) for name, c in structures.items()}
    attach = {name: attach_names(c.data) for name, c in structures.items()}
    cases = tuple(
        StudyCase(a, e, built[a], build_environment(cast("EnvironmentForm", c.form), attach[a]))
        for (a, e), c in surroundings.items()
    )
    inputs = tuple((Path(os.path.relpath(f, base)).as_posix(), sha256_of(f)) for f in files)
    return Study(form=form, folder=base, cases=cases, inputs=inputs, overrides=tuple(overrides))


def _given(table: F | None, name: str) -> F:
    if table is None:
        raise ConfigError(f"the study has no table [{name}]", hint="studies/mace-1993.toml has every table")
    return table


def study_rules(data: dict[str, Any]) -> list[PathFault]:
    """Faults of the tables of a study beyond the form of their keys."""
    return [*study_form.study_findings(data), *signal_findings(data)]


def _is_reference(override: str) -> bool:
    """Whether ``override`` names a file, as ``article.dm=...`` and ``mirror.train=...`` do."""
    parts = override.partition("=")[0].strip().split(".")
    return len(parts) == 2 and parts[0] in ("article", "environment", "mirror")


def _raise_missing(source: Source, data: Any, changed: dict[KeyPath, str], base: Path) -> None:
    """Raise the files that the study names and that are not there, each at its line or override."""
    wanted: list[tuple[KeyPath, str]] = []
    for table in ("article", "environment", "mirror"):
        wanted += [((table, name), file) for name, file in _references(data, table)]
    advice = "a path from the study file's own folder"
    missing = [(key, file) for key, file in wanted if not os.path.isfile(base / file)]
    findings = (finding(key, "no such file", file, hint=advice) for key, file in missing)
    raise_faults([place_in(source, changed, f) for f in findings])


def _references(data: Any, key: str) -> list[tuple[str, str]]:
    table = data.get(key)
    pairs = cast("dict[str, Any]", table).items() if isinstance(table, dict) else ()
    return [(name, path) for name, path in pairs if isinstance(path, str)]


def _check(
    study: Source, articles: dict[str, Source], environments: dict[str, Source], overrides: Sequence[str]
) -> tuple[Checked[Any], dict[str, Checked[Any]], dict[tuple[str, str], Checked[Any]]]:
    """Override and check all documents together; an environment once for each article it may hold."""
    pairs = [(a, e) for a in articles for e in environments]
    parts = [
        (study, study_form.StudyForm, study_rules, ""),
        *((s, ArticleForm, article_findings, name) for name, s in articles.items()),
        *((environments[e], EnvironmentForm, environment_findings, a) for a, e in pairs),
    ]
    checked = overridden(parts, overrides)
    structures = dict(zip(articles, checked[1:], strict=False))
    surroundings = dict(zip(pairs, checked[1 + len(articles) :], strict=True))
    faults: list[DocumentFault] = [f for c in checked for f in c.faults]
    for (a, _), c in surroundings.items():
        faults += join_findings([structures[a], c])
    faults += _joint_faults(checked[0], structures)
    raise_faults(list(dict.fromkeys(faults)))
    return checked[0], structures, surroundings


def _joint_faults(study: Checked[Any], structures: dict[str, Checked[Any]]) -> list[DocumentFault]:
    """Ports and free axes that the study needs and its articles lack; none while any article is broken."""
    if study.form is None or any(c.faults for c in structures.values()):
        return []
    built = {name: build_article(c) for name, c in structures.items()}
    ports = {n: ([a.name for a in s.actuators], [x.name for x in s.sensors]) for n, s in built.items()}
    return [
        *(study.place(finding) for finding in study_form.port_findings(study.form, ports)),
        *(
            structures[name].place(finding)
            for name, structure in built.items()
            for finding in fixed_axes(study.form, name, structure, structures[name].data)
        ),
    ]
