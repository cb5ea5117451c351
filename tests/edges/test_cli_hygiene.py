"""Help, versions, imports, colours and examples of the command line."""

from __future__ import annotations

import os
import pty
import re
import shlex
import subprocess
import sys
from collections import Counter
from pathlib import Path

import pytest

import middeck as package
from cli_runner import HALF_RATE, ROOT, link_documents, middeck, script, share_results
from middeck.cli import main
from middeck.cli.app import VERBS
from repeats import LONG, repeats

Capture = pytest.CaptureFixture[str]
COARSE = ("--set", "mesh.elements_per_strut=1")
HEAVY = ("numpy", "scipy", "pydantic", "matplotlib", "rich")


LIGHT = [["--help"], ["--version"], *([verb, "--help"] for verb in VERBS)]


@pytest.fixture(scope="module")
def imported() -> list[str]:
    """Heavy modules and exit code after each of `LIGHT` in turn, in one process."""
    code = f"""
import sys
from middeck.cli.main import execute
for arguments in {LIGHT!r}:
    code = execute(arguments, lambda: False)
    print("ended", [m for m in {HEAVY!r} if m in sys.modules], code)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    return [line for line in done.stdout.splitlines() if line.startswith("ended ")]


@pytest.mark.parametrize("arguments", LIGHT)
def test_help_and_version_import_nothing_heavy(arguments: list[str], imported: list[str]) -> None:
    assert imported[LIGHT.index(arguments)] == "ended [] 0"


def test_a_deck_is_refused_before_scipy_is_imported(tmp_path: Path) -> None:
    deck = tmp_path / "rod.dat"
    deck.write_text("CEND\nBEGIN BULK\nGRID,1,,0.,0.,0.\nGRID,2,,1.,0.,0.\nCROD,1,7,1,2\nENDDATA\n")
    code = f"""
import sys
from middeck.cli.main import execute
code = execute(["convert", {str(deck)!r}, "--units", "m-kg-s-N"], lambda: False)
print(code, "scipy" in sys.modules)
"""
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert "there is no PROD 7" in done.stderr
    assert done.stdout.split() == ["2", "False"]


@pytest.mark.parametrize("arguments", [["--help"], *([verb, "--help"] for verb in VERBS)])
def test_help_fits_eighty_columns_and_has_two_examples(capfd: Capture, arguments: list[str]) -> None:
    ended = middeck(capfd, *arguments)
    assert ended.code == 0
    assert ended.err == ""
    assert max(map(len, ended.out.splitlines())) <= 80
    assert len(examples(ended.out)) == 2
    # Nothing is cut off; RECORD..., COLUMN,... and [ARGS]... repeat.
    assert "..." not in re.sub(r"[A-Z\]],?\.\.\.", "", ended.out)


def examples(text: str) -> list[list[str]]:
    """The commands below "Examples:", continued lines joined, without the name of the program."""
    below = text.partition("Examples:\n")[2].partition("\n\n")[0].replace("\\\n", " ")
    return [shlex.split(line)[1:] for line in below.splitlines() if line.strip().startswith("middeck")]


def quicker(arguments: list[str]) -> list[str]:
    """The example, but it watches the computer for a second, takes twelve modes, or searches no order."""
    if arguments[0] == "path":
        return [*arguments, "--count", "12", *COARSE]
    if arguments[0] in ("compare", "modes") and "--figure" in arguments:
        return [*arguments, "--count", "12"]
    if arguments[0] in ("identify", "impact") and "--states" not in arguments:
        return [*arguments, "--states", "8" if arguments[0] == "identify" else "4"]
    if arguments[0] != "doctor":
        return arguments
    reported = arguments.index("--seconds") if "--seconds" in arguments else len(arguments)
    return [*arguments[:reported], "--seconds", "1", *arguments[reported + 2 :]]


@pytest.fixture
def project(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """A folder with the project's documents and data, where examples may write."""
    share_results(monkeypatch)
    link_documents(tmp_path)
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.mark.parametrize(
    "verb", [v for v in VERBS if v not in ("study", "impact", "design", "qualify", "generate", "gate")]
)
def test_every_example_of_a_verb_runs(project: Path, capfd: Capture, verb: str) -> None:
    for arguments in examples(middeck(capfd, verb, "--help").out):
        ended = middeck(capfd, *(arguments if LONG else quicker(arguments)))
        assert ended.code == 0, arguments
        assert all(line.startswith("warning: ") for line in ended.err.splitlines()), arguments
        assert ended.out


# The mirror's modes lie beyond half the rate of the example, which is not the mirror's.
@pytest.mark.filterwarnings("default:the compensator rings:UserWarning")
def test_the_examples_that_need_a_file_run_after_those_that_write_it(project: Path, capfd: Capture) -> None:
    writes = next(e for e in examples(middeck(capfd, "identify", "--help").out) if "model.json" in e)
    assert middeck(capfd, *writes).code == 0
    for verb in ("design", "qualify", "generate", "gate"):
        for arguments in examples(middeck(capfd, verb, "--help").out):
            assert middeck(capfd, *arguments).code == 0, arguments
    assert (project / "law.json").exists()


def test_the_examples_of_impact_run_on_a_hammer_test(project: Path, capfd: Capture) -> None:
    page = (ROOT / "docs/how-to/impact-test.md").read_text()
    text = page.split("```python\n")[1].split("```")[0]
    for whole, half in HALF_RATE:
        assert whole in text
        text = text if LONG else text.replace(whole, half)
    exec(text, {})  # writes blows.csv here
    for arguments in examples(middeck(capfd, "impact", "--help").out):
        assert middeck(capfd, *(arguments if LONG else quicker(arguments))).code == 0, arguments
    assert (project / "model.json").exists()


def test_the_version(capfd: Capture) -> None:
    ended = middeck(capfd, "--version")
    assert ended.code == 0
    assert package.__version__ in ended.out


def test_no_verb_is_a_usage_error_with_help_on_stderr(capfd: Capture) -> None:
    ended = middeck(capfd)
    assert (ended.code, ended.out) == (2, "")
    for verb in VERBS:
        assert verb in ended.err


def on_a_terminal(*arguments: str, **variables: str) -> str:
    """What a terminal is sent."""
    ours, theirs = pty.openpty()
    environment = {k: v for k, v in os.environ.items() if k != "NO_COLOR"} | {"TERM": "xterm", **variables}
    process = subprocess.Popen(script(*arguments), stdout=theirs, stderr=theirs, cwd=ROOT, env=environment)
    os.close(theirs)
    sent = b""
    try:
        while part := os.read(ours, 65536):
            sent += part
    except OSError:  # Linux says so when the other side has closed
        pass
    os.close(ours)
    assert process.wait() == 0
    return sent.decode()


def test_escape_codes_only_on_a_terminal_that_wants_them(
    capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(ROOT)
    ask = ("modes", "articles/mace-dm.toml", "--environment", "orbit", "--count", "9", *COARSE)
    with monkeypatch.context() as colourful:
        colourful.setenv("FORCE_COLOR", "1")
        piped = middeck(capfd, *ask)
    assert "\x1b" not in piped.out + piped.err
    fancy = on_a_terminal(*ask)
    assert "\x1b[" in fancy
    assert "translation x" in fancy
    for variables in repeats(({"NO_COLOR": "1"}, {"TERM": "dumb"})):
        assert on_a_terminal(*ask, **variables).replace("\r\n", "\n") == piped.out


def test_a_reader_that_has_seen_enough_is_no_error() -> None:
    ask = ("modes", "articles/mace-dm.toml", "--environment", "orbit", "--json", *COARSE)
    command = shlex.join(script(*ask))
    done = subprocess.run(
        ["bash", "-c", f"{command} | true; echo ${{PIPESTATUS[0]}}"], capture_output=True, text=True, cwd=ROOT
    )
    assert (done.stdout, done.stderr) == ("0\n", "")


def test_of_warnings_that_differ_in_numbers_alone_the_first_is_shown(capfd, monkeypatch):
    monkeypatch.setattr(main, "SHOWN", Counter())
    for text in ("modes 'a' couple by 0.21", "modes 'b' couple by 0.21", "modes 'a' couple by 1.9e-05"):
        main._show_warning(text)
    main._count_alike()
    assert capfd.readouterr().err.splitlines() == [
        "warning: modes 'a' couple by 0.21",
        "warning: modes 'b' couple by 0.21",
        "warning: more that differ from one above in numbers alone: 1",
    ]


NAMES = tuple(
    f.format(k) for f in ("run{}.uff", "gimbal_{}", "r.{}.uff", "{}x", "a-{}", "'{}'", "d/{}/r") for k in "12"
)


def test_numbers_within_names_are_not_what_warnings_differ_in_alone(capfd, monkeypatch):
    monkeypatch.setattr(main, "SHOWN", Counter())
    for name in NAMES:
        main._show_warning(f"{name}: the line at 0 Hz is left out")
        main._show_warning(f"{name}: the line at 1.5e+01 Hz is left out")
    for text in (
        "joint 'g1', -3 of 4.",
        "joint 'g1', -5 of 6.",
        "joint 'g2', -3 of 4.",
        "at 12.25Hz",
        "at 3Hz",
    ):
        main._show_warning(text)
    main._count_alike()
    shown = capfd.readouterr().err.splitlines()
    assert shown[:-5] == [f"warning: {name}: the line at 0 Hz is left out" for name in NAMES]
    assert shown[-1].endswith(f"alone: {len(NAMES) + 1}")
