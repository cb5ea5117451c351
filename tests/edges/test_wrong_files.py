"""A file of every kind handed to every place, TOML that is not, and hints that name what is there."""

from __future__ import annotations

import ast
import functools
import json
import re
from pathlib import Path

import numpy as np
import pytest

from cli_runner import ROOT
from cli_runner import middeck as run
from middeck.cli.app import VERBS, verb_options
from middeck.cli.shown.advice import on_command_line, public_names
from middeck.errors import ConfigError, MiddeckError
from middeck.files.articles.form import ArticleForm
from middeck.files.disk.kind_of_content import KEYS, looks_like
from middeck.files.environments.form import EnvironmentForm
from middeck.files.laws.packages import load_package
from middeck.files.measured.models import load_model
from middeck.files.measured.modes import load_measured_modes
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.promises.outcomes import load_outcomes
from middeck.files.promises.plans import load_plan
from middeck.files.records import load_record, write_record
from middeck.files.refinements.candidate_documents import load_candidates
from middeck.files.refinements.documents import load_refinement
from middeck.files.refinements.promised_loads import load_promised_loads
from middeck.files.setups import load_environment, load_structure
from middeck.files.studies.documents import load_study
from middeck.files.studies.form import StudyForm
from middeck.files.toml.form import Form, bare, is_form
from middeck.files.toml.source import read_source
from middeck.signals.ports import Port
from middeck.signals.record import Record

ARTICLE = ROOT / "articles/mace-dm.toml"
LAB = ROOT / "environments/lab.toml"
STUDY = ROOT / "studies/mace-1993.toml"
SURVEY = ROOT / "data/virtual-survey/mace-simple-lab.json"
Capture = pytest.CaptureFixture[str]


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """One file of each kind."""
    path = tmp_path_factory.mktemp("kinds")
    for name, source in (("article", ARTICLE), ("environment", LAB), ("study", STUDY), ("survey", SURVEY)):
        (path / f"{name}{source.suffix}").write_bytes(source.read_bytes())
    for name in ("refine", "candidates", "promise", "outcome"):
        (path / f"{name}.toml").write_bytes((SURVEY.parent / f"{name}.toml").read_bytes())
    text = ARTICLE.read_text(encoding="utf-8")
    (path / "bom.toml").write_text("\ufeff" + text, encoding="utf-8")
    (path / "crlf.toml").write_bytes(text.replace("\n", "\r\n").encode())
    (path / "latin.toml").write_bytes(b'schema = 1\nname = "caf\xe9"\n')
    (path / "wide.toml").write_text(text, encoding="utf-16")
    (path / "empty.toml").write_text("")
    (path / "blank.json").write_text(" \n")
    (path / "model.json").write_text(json.dumps({"schema": "middeck.model/1"}))
    (path / "law.json").write_text(json.dumps({"schema": "middeck.compensator/1"}))
    (path / "modes.json").write_text(json.dumps({"schema": "middeck.modes/1"}))
    (path / "cut.json").write_text('{"schema": "middeck.model/1", "poles')
    (path / "noise.toml").write_bytes(bytes(range(256)) * 8)
    (path / "drawing.svg").write_text("<svg/>")
    (path / "table.csv").write_text("a,b\n1,2\n")
    y = np.random.default_rng(1).standard_normal((1, 1, 32, 1))
    write_record(
        path / "record.npz",
        Record(sample_hz=8.0, u=y, y=y, inputs=(Port("u", "N"),), outputs=(Port("y", "m"),), periodic=False),
    )
    (path / "folder.toml").mkdir()
    return path


LOOKS = {
    "article.toml": "an article",
    "bom.toml": "an article",
    "crlf.toml": "an article",
    "environment.toml": "an environment",
    "study.toml": "a study",
    "survey.json": "the measured modes of a survey",
    "refine.toml": "a refinement",
    "candidates.toml": "a list of candidate tests",
    "promise.toml": "the plan of a promise",
    "outcome.toml": "an outcome",
    "model.json": "a fitted model",
    "cut.json": "a fitted model",
    "law.json": "a compensator",
    "modes.json": "what middeck modes --json prints",
    "empty.toml": "an empty file",
    "blank.json": "an empty file",
    "latin.toml": "text that is not UTF-8",
    "wide.toml": "text that is not UTF-8",
    "noise.toml": "a binary file",
    "drawing.svg": "a drawing or a web page",
    "table.csv": "a table of numbers",
    "record.npz": "an archive of arrays (NPZ)",
    "folder.toml": "a folder",
}


@pytest.mark.parametrize("name", LOOKS)
def test_a_file_looks_like_what_it_is(folder: Path, name: str) -> None:
    assert looks_like(folder / name) == LOOKS[name]


def test_the_keys_by_which_documents_are_known_are_theirs_alone() -> None:
    forms: dict[str, type[Form]] = {
        "an article": ArticleForm,
        "an environment": EnvironmentForm,
        "a study": StudyForm,
    }
    for kind, form in forms.items():
        others = [f for k, f in forms.items() if k != kind]
        assert KEYS[kind] <= set(form.model_fields)
        assert not any(KEYS[kind] & set(other.model_fields) for other in others)


READERS = {
    "article": (load_structure, ("article.toml", "bom.toml", "crlf.toml")),
    "environment": (load_environment, ("environment.toml",)),
    "study": (load_study, ("study.toml",)),
    "survey": (load_measured_modes, ("survey.json",)),
    "model": (load_model, ()),
    "record": (load_record, ("record.npz",)),
    "refinement": (lambda path: load_refinement(path, ARTICLE), ()),
    "candidates": (lambda path: load_candidates(path, ARTICLE), ()),
    "promise plan": (lambda path: load_plan(path, ARTICLE), ()),
    "promised loads": (lambda path: load_promised_loads(path, ARTICLE), ()),
    "outcome": (load_outcomes, ()),
    "package": (load_package, ()),
    "deck": (read_deck, ()),
}
FOREIGN = (
    "article.toml",
    "environment.toml",
    "study.toml",
    "survey.json",
    "refine.toml",
    "candidates.toml",
    "promise.toml",
    "outcome.toml",
)
# These name files that are not in the folder, or surveys that fit another article.
OWN_WORDS = {
    ("refinement", "refine.toml"),
    ("candidates", "candidates.toml"),
    ("promise plan", "promise.toml"),
    ("outcome", "outcome.toml"),
}


@pytest.mark.parametrize("reader", READERS)
def test_every_reader_refuses_what_is_not_its_own_in_a_few_words(folder: Path, reader: str) -> None:
    read, own = READERS[reader]
    for name in own:
        read(STUDY if reader == "study" else folder / name)
    for name in (n for n in LOOKS if n not in own):
        with pytest.raises(MiddeckError) as caught:
            read(folder / name)
        text = str(caught.value)
        assert len(text.splitlines()) <= 3, text
        assert str(folder) in text
        kinds = [LOOKS[kind] for kind in FOREIGN]
        if LOOKS[name] in kinds and (reader, name) not in OWN_WORDS:
            assert f"looks like {LOOKS[name]}" in text


def test_article_and_environment_swapped_is_one_message(capfd: Capture) -> None:
    for verb in ("modes", "compare", "budget", "path", "response", "level", "sensitivity"):
        more = {
            "response": ("--input", "a", "--output", "b", "--at", "1"),
            "level": ("--free", "n1.z"),
            "sensitivity": ("--parameter", "*"),
        }.get(verb, ())
        ended = run(capfd, verb, LAB, "--environment", ARTICLE, *more)
        assert ended.code == 2
        assert "environment and article are swapped" in ended.err
        assert len(ended.err.splitlines()) == 2
    assert "are swapped" in run(capfd, "check", LAB, ARTICLE).err


@pytest.fixture
def elsewhere(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder of the user's own, where the command runs."""
    monkeypatch.chdir(tmp_path)
    return tmp_path


def test_the_laboratory_needs_no_file(elsewhere: Path, capfd: Capture) -> None:
    """The one that is built in hangs the article as the repository's does."""
    (elsewhere / "own.toml").write_bytes(ARTICLE.read_bytes())
    ended = run(capfd, "modes", "own.toml", "--environment", "lab", "--json")
    named = run(capfd, "modes", ARTICLE, "--environment", "lab", "--json")
    assert ended.code == 0
    assert ended.out == named.out
    (elsewhere / "lab.toml").write_text(LAB.read_text().replace("bounce_hz = 0.25", "bounce_hz = 0.5"))
    own = run(capfd, "modes", "own.toml", "--environment", "lab", "--json")
    assert own.out != named.out


def test_an_article_without_attach_points_hangs_in_no_laboratory(elsewhere: Path, capfd: Capture) -> None:
    text = ARTICLE.read_text()
    (elsewhere / "own.toml").write_text(text[: text.index("\n[suspension]")])
    ended = run(capfd, "modes", "own.toml", "--environment", "lab")
    assert ended.code == 2
    assert "no attach point to hang from" in ended.err
    assert "a table [suspension] with nodes = [names] and offsets_m" in ended.err


TIED = """
[[attach]]
name = "low"
frame = "n1"

[[attach]]
name = "high"
frame = "n5"

[[spring]]
name = "tie"
from = "low"
to = "high"
stiffness_n_per_m = 1000.0
free_length_m = 1.0
"""


def test_an_article_does_not_hang_from_ends_of_its_springs(elsewhere: Path, capfd: Capture) -> None:
    text = ARTICLE.read_text()
    (elsewhere / "own.toml").write_text(text[: text.index("\n[suspension]")] + TIED)
    ended = run(capfd, "modes", "own.toml", "--environment", "lab")
    assert ended.code == 2
    assert "no attach point to hang from" in ended.err
    assert "clamps" in ended.err
    assert "site-packages" not in ended.err + ended.out
    assert "src/middeck" not in ended.err


# ---- TOML that is not --------------------------------------------------------------------------------------

SYNTAX = {
    "bounce_hz = 0,25": (3, "a decimal comma", "bounce_hz = 0.25"),
    "mass_kg = 3 kg": (3, "a unit after the number", "mass_kg = 3:"),
    "angle = 5°": (3, "a unit after the number", "angle = 5:"),
    "name = n1": (3, "a text without quotes", 'name = "n1"'),
    'name = "n1': (3, "a quote that is not closed", 'name = "n1"'),
    'name = n1"': (3, "a text without quotes", 'name = "n1"'),
    "name = “n1”": (3, "typographic quotes", "straight quotes"),
    "x = .5": (3, "before its point", "x = 0.5"),
    "x = -.5": (3, "before its point", "x = -0.5"),
    "x = 5.": (3, "after its point", "x = 5.0"),
    "x = 007": (3, "begins with 0", "leading zeros"),
    "x =": (3, "a key without a value", "leave the line out"),
    "x = True": (3, "'True'", "true or false"),
    "x = 3;": (3, "a semicolon", "leave it out"),
    "x: 3": (3, "a colon", "x = 3"),
    "[node": (3, "head of a table", "[node]"),
    "[[node]": (3, "head of a table", "[[node]]"),
    "// a note": (3, "a comment that TOML does not know", "#"),
    "just words": (3, "neither a table nor", "key = value"),
    "x = [1.0, 2.0": (3, "an array that is not closed", "]"),
    'x = "C:\\data"': (3, "a backslash", "forward slashes"),
    "schema = 2": (3, "'schema' is there twice", "leave one"),
    "x = −0.02": (3, "a typographic minus", "-"),
    "x = [0.0, –0.02]": (3, "a typographic minus", "-"),
    "x\u00a0= 1.2": (3, "a space that is none to TOML", "plain space"),
    "E_pa = 70.0d9": (3, "an exponent of Fortran", "E_pa = 70.0e9"),
    "E_pa = 1D-3": (3, "an exponent of Fortran", "E_pa = 1e-3"),
    "E_pa = 70*10^9": (3, "arithmetic", "the number that it gives"),
    "x = 6/5": (3, "arithmetic", "the number that it gives"),
    "E_pa = 70,000,000,000": (3, "separators in a number", "70_000"),
    "E_pa = 70 000 000 000": (3, "separators in a number", "70_000"),
    "x = nan\ny = [1 2]": (4, "y = [1 2]", "mend this line"),
    "mass_kg = NaN": (3, "'NaN'", "a finite number"),
    "[[node]]\nx_m = np.float64(0.5)": (4, "as NumPy prints it", "0.5"),
    "[[node]]\nx_m = 1 2": (4, "newline", "mend this line"),
    "[a.b] # c\nx_m = 1 2": (4, "newline", "mend this line"),
    "[a]\nb = 1\n[a]": (5, "table [a] is there twice, first on line 3", "[[a]]"),
}


@pytest.mark.parametrize("text", SYNTAX)
def test_a_line_that_is_not_toml_is_reported_with_its_cure(tmp_path: Path, text: str) -> None:
    line, what, cure = SYNTAX[text]
    path = tmp_path / "a.toml"
    path.write_text(f"schema = 1\n# a comment\n{text}\n", encoding="utf-8")
    with pytest.raises(ConfigError) as caught:
        read_source(path)
    (fault,) = caught.value.data["faults"]
    assert fault.line == line
    assert what in fault.message
    assert text.splitlines()[-1].strip() in fault.message or "twice" in fault.message
    assert cure in fault.hint


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("[0.06, 0.045, 0.08]", "[0,06, 0,045, 0,08]", "decimal commas in an array"),
        ("cg_m = [0.0, -0.03, 0.0]", "cg_m = [0,1, -1,3, 0,2]", "decimal points"),
        ("mass_kg = 3.0", "Mass_kg = 3.0", "'mass_kg'?"),
        ("mass_kg = 3.0", "MASS_KG = 3.0", "'mass_kg'?"),
        ("mass_kg = 3.0", "mass_lb = 3.0", "in kg"),
        ('to = "n2"', 'to = "n2"\nup = "-Y"', "up = [0.0, -1.0, 0.0]"),
    ],
)
def test_numbers_and_words_that_are_toml_but_not_meant(tmp_path: Path, old: str, new: str, says: str) -> None:
    text = ARTICLE.read_text(encoding="utf-8")
    if old not in text:
        pytest.fail(f"{old} is not in the article")
    path = tmp_path / "a.toml"
    path.write_text(text.replace(old, new, 1), encoding="utf-8")
    with pytest.raises(ConfigError, match=re.escape(says)):
        load_structure(path)


# ---- hints -------------------------------------------------------------------------------------------------


def text_of(node: ast.expr) -> str:
    """A hint as far as its source tells; what is put in is one word."""
    match node:
        case ast.Constant():
            return str(node.value)
        case ast.JoinedStr():
            return "".join(text_of(v) for v in node.values)
        case ast.BinOp():
            return text_of(node.left) + text_of(node.right)
        case _:
            return "VALUE"


@functools.cache
def hints() -> list[tuple[str, str]]:
    found = []
    for file in sorted((ROOT / "src/middeck").rglob("*.py")):
        text = file.read_text(encoding="utf-8")
        for node in ast.walk(ast.parse(text)) if "hint=" in text else ():
            if isinstance(node, ast.Call):
                found += [
                    (file.relative_to(ROOT / "src/middeck").as_posix(), text_of(k.value))
                    for k in node.keywords
                    if k.arg == "hint"
                ]
    return found


OPTIONS = {verb: verb_options(verb) for verb in VERBS}
PYTHON = r"\b\w+\([^)]*\)|(?<![\w.-])[a-z_]+=[\w\[\"']|\b[A-Z][a-z]+[A-Z]\w*"


def test_hints_are_found() -> None:
    assert len(hints()) > 500


def test_no_hint_of_the_library_names_an_option() -> None:
    """Who calls a function has no command line; ``--set`` is the name of what an override is."""
    assert not [
        h for h in hints() if not h[0].startswith("cli/") and re.search(r"(?<!\w)--(?!set)[a-z]", h[1])
    ]


@pytest.mark.parametrize("verb", VERBS)
def test_no_hint_of_a_verb_names_python_or_an_option_that_it_lacks(verb: str) -> None:
    every = {o for own in OPTIONS.values() for o in own}
    for place, hint in hints():
        message = on_command_line(hint, verb, OPTIONS, public_names())
        assert not re.search(PYTHON, message.replace("VALUE", "")), (place, message)
        for option in re.findall(r"(?<![\w-])--[a-z][\w-]*", message):
            assert option in every
            there = option in OPTIONS[verb] or any(option in OPTIONS[v] for v in VERBS if v in message)
            assert there, (place, message)


def test_a_hint_of_the_command_line_itself_names_its_options() -> None:
    """In cli/verbs, those of the verb itself."""
    for place, hint in hints():
        if place.startswith("cli/verbs/"):
            verb = Path(place).stem
            assert on_command_line(hint, verb, OPTIONS, ()) == hint


def keys(form: type[Form]) -> set[str]:
    found: set[str] = set()
    for name, field in form.model_fields.items():
        found.add(field.alias or name)
        inner = bare(field.annotation)
        for part in (inner, *getattr(inner, "__args__", ())):
            if is_form(bare(part)):
                found |= keys(bare(part))
    return found


def test_a_key_that_a_hint_advises_is_taken(tmp_path: Path) -> None:
    """An inertia that no body has, of a node and of a payload; with the key it is taken."""
    text = ARTICLE.read_text(encoding="utf-8")
    for table, key in (("node", "inertia_kg_m2"), ("gimbal", "payload_inertia_kg_m2")):
        start = text.index(f"[[{table}]]")
        place = text.index(f"\n{key} = ", start) + 1
        end = text.index("\n", place)
        path = tmp_path / f"{table}.toml"
        path.write_text(text[:place] + f"{key} = [0.1, 0.1, 0.9]" + text[end:], encoding="utf-8")
        with pytest.raises(ConfigError) as caught:
            load_structure(path)
        (fault,) = caught.value.data["faults"]
        assert "triangle" in fault.message
        assert "rotors_excluded = true" in fault.hint
        path.write_text(path.read_text().replace(f"{key} = [0.1", f"rotors_excluded = true\n{key} = [0.1"))
        load_structure(path)


def test_correlate_speaks_of_its_option(tmp_path: Path, capfd: Capture) -> None:
    survey = json.loads(SURVEY.read_text())
    (tmp_path / "s.json").write_text(
        json.dumps({k: v for k, v in survey.items() if not k.endswith("std") and "std" not in k})
    )
    ended = run(capfd, "correlate", ROOT / "articles/mace-simple.toml", tmp_path / "s.json")
    assert ended.code == 2
    assert "--noise 0.001,0.02" in ended.err
    assert "MeasurementNoise" not in ended.err


def test_records_speak_of_options_where_there_are_any(tmp_path: Path, capfd: Capture) -> None:
    path = tmp_path / "r.csv"
    path.write_text("\n".join(["a,b", *(f"{k},{k * k}" for k in range(40))]))
    assert "--inputs" in run(capfd, "identify", path).err
    other = tmp_path / "other.csv"
    other.write_text(path.read_text())
    ended = run(capfd, "drift", path, other)
    assert "--inputs" not in ended.err
    assert "[[channel]]" in ended.err
    with pytest.raises(MiddeckError, match="name_columns"):
        load_record(path)


REFINE, PLAN = SURVEY.parent / "refine.toml", SURVEY.parent / "promise.toml"


@pytest.mark.parametrize(
    ("verb", "more"),
    [("refine", [REFINE]), ("promise", [PLAN]), ("compare", []), ("budget", []), ("path", [])],
)
def test_gravity_is_not_taken_out_of_a_measurement(
    tmp_path: Path, capfd: Capture, verb: str, more: list[Path]
):
    """A fitted model where an article is asked for: refused with the reason, which a survey is not told."""
    model = tmp_path / "fitted.json"
    for schema, warning in (("model", True), ("measured-modes", False)):
        model.write_text(f'{{"schema": "middeck.{schema}/1"}}', encoding="utf-8")
        ended = run(capfd, verb, model, *more)
        assert ended.code == ConfigError.exit_code
        assert ("gravity and suspension are in all modes of a measurement" in ended.err) == warning
