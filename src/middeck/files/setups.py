"""Read articles and environments; every configuration error of all of them at once."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any, cast

from middeck.arguments import named_kinds
from middeck.errors import ConfigError
from middeck.files.articles.build import build_structure
from middeck.files.articles.checks import article_findings
from middeck.files.articles.components import PUNCHED
from middeck.files.articles.form import ArticleForm
from middeck.files.articles.names import attach_names, hanging_names, names_in
from middeck.files.disk import kind_of_content
from middeck.files.environments.checks import environment_findings
from middeck.files.environments.form import EnvironmentForm, build_environment, joint_findings
from middeck.files.nastran.deck.deck_lines import Lines
from middeck.files.toml.faults import DocumentFault, finding, nearest, raise_faults
from middeck.files.toml.form import Form
from middeck.files.toml.overrides import OverriddenDocument, apply_overrides
from middeck.files.toml.source import WANTED, Checked, Kind, Source, check, read_source, read_sources, refuse
from middeck.structure.model.article import Structure
from middeck.structure.model.environment import Environment
from middeck.structure.sensitivity.parameters import scale_parameters

# What ``--environment orbit`` means far from any environments/: it is the same everywhere.
BUILT_IN = {name: Path(__file__).with_name(f"{name}.toml") for name in ("orbit", "lab")}
FOLDERS: dict[Kind, str] = {"article": "articles", "environment": "environments", "study": "studies"}


@named_kinds
def load_structure(path: str | Path, overrides: Sequence[str] = ()) -> Structure:
    """The article in file ``path``; raises `ConfigError` with all its faults."""
    source = read_source(path, kind_of_content.ARTICLE)
    article = _check_all([(source, ArticleForm, article_findings)], overrides)[0]
    return build_article(article)


def article_files(path: str | Path) -> tuple[Path, ...]:
    """The file of an article, those of its components, and what their cards include."""
    found = [Path(path)]
    for part in read_source(path, kind_of_content.ARTICLE).data.get("component", ()):
        matrices, *cards = (Path(path).parent / f for f in (part["file"], *part.get("cards", ())))
        held = matrices.suffix in PUNCHED
        found += [] if held else [matrices]
        found += (f for card in ([matrices] if held else []) + cards for f in Lines(card).files)
    return tuple(dict.fromkeys(found))


@named_kinds
def load_environment(path: str | Path, overrides: Sequence[str] = ()) -> Environment:
    """The environment in file ``path``, or "orbit"; raises `ConfigError` with all its faults.

    "lab" needs the attach points of an article: see `load_setup`.
    """
    source = read_source(_environment_file(path), kind_of_content.ENVIRONMENT)
    checked = _check_all([(source, EnvironmentForm, environment_findings)], overrides)[0]
    return _environment(checked)


@named_kinds
def load_setup(
    article: str | Path, environment: str | Path, overrides: Sequence[str] = ()
) -> tuple[Structure, Environment]:
    """An article and an environment, joined by the names of attach points.

    ``environment`` is a file, or "orbit" or "lab", which need none: in "lab" the article hangs along x on a
    cable of 4 m at each attach point where no spring or bushing ends, at 0.25 Hz. Raises `ConfigError` with
    all faults of both, among them names that the article lacks.
    """
    first, second = _check_case(article, environment, overrides)
    return build_article(first), _environment(second, hanging_names(first.data))


def load_offset_keys(
    article: str | Path, environment: str | Path, overrides: Sequence[str] = ()
) -> dict[str, str]:
    """Attach point = the key of its offset in the article's file, which an override may set.

    Raises `ConfigError` as `load_setup` does.
    """
    form = cast("ArticleForm", _check_case(article, environment, overrides)[0].form)
    nodes = () if form.suspension is None else form.suspension.nodes
    hung = {name: f"suspension.offsets_m.{i}" for i, name in enumerate(nodes)}
    return hung | {point.name: f"attach.{point.name}.offset_m" for point in form.attach}


def _check_case(article: str | Path, environment: str | Path, overrides: Sequence[str]) -> list[Checked[Any]]:
    """The article, then the environment."""
    around = _environment_file(environment)
    if (kind_of_content.looks_like(article), kind_of_content.looks_like(around)) == (
        kind_of_content.ENVIRONMENT,
        kind_of_content.ARTICLE,
    ):
        refuse(f"{article}, {around}", "environment and article are swapped", "the article first")
    body, surroundings = read_sources([article, around], ["article", "environment"])
    return _check_all(
        [(body, ArticleForm, article_findings), (surroundings, EnvironmentForm, environment_findings)],
        overrides,
    )


def _environment_file(given: str | Path) -> str | Path:
    """The path as given; the file of a built-in environment of this name, unless a file has the name."""
    return given if Path(given).is_file() else BUILT_IN.get(str(given), given)


def build_article(checked: Checked[Any]) -> Structure:
    """The structure of a checked article with its ``[factors]``; `ConfigError` for one of no number."""
    form = cast("ArticleForm", checked.form)
    built = build_structure(form, Path(checked.file).parent)
    faults = []
    for name, factor in form.factors.items():
        try:
            built = scale_parameters(built, {name: factor})
        except ConfigError as error:
            faults.append(checked.place(finding(("factors", name), error.what, hint=error.hint)))
    raise_faults(faults)
    return built


def _environment(checked: Checked[Any], attach: Sequence[str] = ()) -> Environment:
    return build_environment(cast("EnvironmentForm", checked.form), attach)


def _check_all(
    sources: Sequence[tuple[Source, type[Form], Any]], overrides: Sequence[str]
) -> list[Checked[Any]]:
    """Override and check documents that belong to one case; raises all their faults together."""
    article = next((str(s.data.get("name")) for s, form, _ in sources if form is ArticleForm), "")
    checked = overridden([(*source, article) for source in sources], overrides)
    faults = [*(f for c in checked for f in c.faults), *join_findings(checked)]
    raise_faults(list(dict.fromkeys(faults)))  # an override of two documents may be wrong in both
    return checked


def overridden(
    parts: Sequence[tuple[Source, type[Form], Any, str]], overrides: Sequence[str]
) -> list[Checked[Any]]:
    """Documents with ``overrides``, each checked: its form, further rules, and the article it belongs to."""
    targets = [OverriddenDocument(called(s.file), s.data, form, article) for s, form, _, article in parts]
    return [
        check(source, data, marks, form, more)
        for (source, form, more, _), data, marks in zip(
            parts, *apply_overrides(targets, overrides), strict=True
        )
    ]


def join_findings(checked: Sequence[Checked[Any]]) -> list[DocumentFault]:
    """Faults where environments name what the article among ``checked`` lacks."""
    articles = [c for c in checked if isinstance(c.form, ArticleForm)]
    if not articles:
        return []
    data = articles[0].data
    return [
        c.place(finding)
        for c in checked
        if isinstance(c.form, EnvironmentForm)
        for finding in joint_findings(
            c.form, attach_names(data), names_in(data, "node"), names_in(data, "wheel"), data["name"]
        )
    ]


def called(file: str) -> str:
    """The file, or the name of an environment that needs none."""
    return next((f"environment {name!r}" for name, path in BUILT_IN.items() if str(path) == file), file)


def find_stated(name: str, document: str | Path) -> Path:
    """The environment that a document calls ``name``.

    A path from the document's folder or the one above, NAME.toml there or in the folder ``environments`` next
    to the document's, or one that needs no file: the same from whatever folder the document is read. Only
    what is none of these is sought in the current folder, as by `find_document`.
    """
    own, home = Path(document).parent / name, Path(document).resolve().parent
    named = (folder / f"{name}.toml" for folder in (home, home.parent / FOLDERS["environment"]))
    found = next((file for file in (own, home.parent / name, *named) if file.is_file()), BUILT_IN.get(name))
    return found or find_document(name, "environment", document)


def find_document(name: str, kind: Kind, beside: str | Path | None = None) -> Path:
    """The file that ``name`` means: an existing path, else ``articles/NAME.toml`` and the like.

    The folder is sought in the current folder, then next to the folder of the file ``beside``, so that an
    article's environments are found from anywhere; so is a file of this name beside that file. The
    environments ``orbit`` and ``lab`` need no file. Raises `ConfigError` with the nearest name there is.
    """
    given, wanted = Path(name), WANTED[kind]
    if not name:
        raise ConfigError(f"no name of {wanted}: the text is empty", hint="a path, or a name")
    if given.is_file():
        return given
    own = [] if beside is None else [Path(beside).resolve().parent]
    folders = [Path(FOLDERS[kind]), *(folder.parent / FOLDERS[kind] for folder in own), *own]
    for folder in folders:
        if (folder / f"{name}.toml").is_file():
            return folder / f"{name}.toml"
    if kind == "environment" and name in BUILT_IN:
        return BUILT_IN[name]
    if given.is_dir():
        raise ConfigError(f"{name} is a folder, not {wanted}", hint=f"the path of {wanted} file")
    built_in = BUILT_IN if kind == "environment" else ()
    files = [p for folder in folders for p in folder.glob("*.toml")]
    known = sorted({*built_in, *(p.stem for p in files if kind_of_content.looks_like(p) == wanted)})
    advice = nearest(name, known) or f"give the path of {wanted} file"
    beside_it = [p.name for p in given.parent.glob("*.toml") if kind_of_content.looks_like(p) == wanted]
    if not advice.startswith("did") and (close := nearest(given.name, beside_it)).startswith("did"):
        advice = close
    if (given.suffix or len(given.parts) > 1) and not advice.startswith("did"):
        advice = f"check the path; {advice}" if known else "check the path"
    raise ConfigError(f"no {kind} {name!r}", hint=advice)
