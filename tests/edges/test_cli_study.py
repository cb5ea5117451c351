"""``middeck study`` as a process: progress, results, and what an interruption leaves behind."""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import xml.etree.ElementTree as ET
from collections.abc import Mapping
from pathlib import Path

import pytest

from cli_runner import ROOT, middeck, script
from middeck.cli.main import execute
from middeck.cli.shown.progress import follow
from middeck.study.mission import CHAPTERS
from repeats import LONG, repeats

NAMES = [chapter.name for chapter in CHAPTERS]
STUDY = ROOT / "studies/mace-1993.toml"
COARSE = () if LONG else ("--set", "mesh.elements_per_strut=2")
Capture = pytest.CaptureFixture[str]


def whole_files_only(out: Path) -> list[str]:
    """The names of what is in ``out``; fails on a temporary file and on one that is cut off."""
    files = sorted(p for p in out.rglob("*") if p.is_file())
    for path in files:
        assert path.suffix in (".svg", ".json", ".html"), path
        assert not path.name.startswith("."), path
        if path.suffix == ".svg":
            ET.fromstring(path.read_text(encoding="utf-8"))
        elif path.suffix == ".json":
            json.loads(path.read_text(encoding="utf-8"))
        else:
            assert path.read_text(encoding="utf-8").rstrip().endswith("</html>")
    return [p.name for p in files]


def wait_until_it_listens(process: subprocess.Popen[str]) -> None:
    """Until our handler of SIGTERM is there (Linux tells); before that, Python itself is still starting."""
    status = Path(f"/proc/{process.pid}/status")
    bit = 1 << (signal.SIGTERM - 1)
    while process.poll() is None and status.exists():
        caught = next(line for line in status.read_text().splitlines() if line.startswith("SigCgt:"))
        if int(caught.split()[1], 16) & bit:
            return
        time.sleep(0.005)
    time.sleep(1.0)


def interrupted(out: Path, number: int, *, after: str | float) -> tuple[int, str]:
    """Start the study, send the signal so many seconds later or when ``after`` has been printed.

    Returns exit code and stderr.
    """
    process = subprocess.Popen(
        script("study", STUDY, "-o", out, *COARSE),
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        cwd=ROOT,
    )
    assert process.stderr is not None
    message = ""
    wait_until_it_listens(process)
    if isinstance(after, str):
        while after not in message:
            line = process.stderr.readline()
            assert line, message
            message += line
    else:
        time.sleep(after)
    process.send_signal(number)
    stdout, rest = process.communicate(timeout=60)
    assert stdout == ""
    return process.returncode, message + rest


# The first moments are spent importing, the later ones computing and drawing.
@pytest.mark.parametrize("after", repeats(["figures 4 and 5", 0.1, 1.2, 0.0, 0.5, 2.0, "figure 6"], 3))
def test_ctrl_c_leaves_whole_files_and_code_130(tmp_path: Path, after: str | float) -> None:
    code, message = interrupted(tmp_path / "out", signal.SIGINT, after=after)
    assert code == 130, message
    assert message.rstrip().splitlines()[-1] == "interrupted"
    assert "Traceback" not in message
    names = whole_files_only(tmp_path / "out")
    assert "report.html" not in names
    if isinstance(after, str):
        assert "figure-4.svg" in names


@pytest.mark.parametrize("after", repeats([0.5, "figures 4 and 5"]))
def test_sigterm_ends_it_alike(tmp_path: Path, after: str | float) -> None:
    code, message = interrupted(tmp_path / "out", signal.SIGTERM, after=after)
    assert (code, message.rstrip().splitlines()[-1]) == (130, "interrupted")
    assert ("figure-4.svg" in whole_files_only(tmp_path / "out")) == isinstance(after, str)


LOST = {
    "in a weak-reference callback": """
class Value: pass
value = Value()
watched = weakref.ref(value, lambda _: (interrupt(), time.sleep(0.0)))
del value
""",
    "in an import that may fail": """
try:
    try:
        interrupt()
    except KeyboardInterrupt:
        raise ImportError("core failed to import") from None
except Exception:
    pass
""",
}


def run_interrupted(steps: str) -> subprocess.CompletedProcess[str]:
    """A program that catches interruptions as the command line does, taking ``steps`` and waiting."""
    program = f"""
import os, signal, sys, time, weakref
from middeck.cli.main import catch_interrupts

def interrupt():
    os.kill(os.getpid(), signal.SIGINT)

seen = catch_interrupts()
{steps}
print("goes on")
try:
    time.sleep(20.0)
except KeyboardInterrupt:
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    sys.exit(130 if seen() else 1)
"""
    return subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, timeout=60)


@pytest.mark.parametrize("steps", LOST.values(), ids=LOST.keys())
def test_a_lost_interruption_comes_again(steps: str) -> None:
    done = run_interrupted(steps)
    assert (done.returncode, done.stdout, done.stderr) == (130, "goes on\n", "")


CLEANED_UP = {
    "where it came": """
def work():
    try:
        interrupt()
    finally:
        time.sleep(0.3)
        print("cleaned")
""",
    "in a generator that is left": """
def steps():
    try:
        yield
    finally:
        time.sleep(0.3)
        print("cleaned")

def work():
    for _ in steps():
        interrupt()
""",
}


@pytest.mark.parametrize("steps", CLEANED_UP.values(), ids=CLEANED_UP.keys())
def test_an_interruption_does_not_come_again_while_it_is_cleaned_up_after(steps: str) -> None:
    done = run_interrupted(
        f"""
{steps}
try:
    work()
except KeyboardInterrupt:
    pass
"""
    )
    assert (done.returncode, done.stdout, done.stderr) == (130, "cleaned\ngoes on\n", "")


def test_a_lost_interruption_does_not_come_again_while_the_error_it_became_is_reported(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    import traceback

    from middeck.cli.app import app

    def lost(*_: object, **__: object) -> None:
        signal.setitimer(signal.ITIMER_REAL, 50.0)
        raise ImportError("core failed to import")

    left: list[float] = []
    monkeypatch.setattr(app, "main", lost)
    monkeypatch.setattr(traceback, "print_exc", lambda: left.append(signal.getitimer(signal.ITIMER_REAL)[0]))
    assert execute(["--debug"], lambda: True) == 130
    assert left == [0.0]


def test_a_campaign_of_interruptions(tmp_path: Path, campaign) -> None:
    import numpy as np

    for seed in campaign(20):
        after = float(np.random.default_rng(seed).uniform(0.0, 20.0 if LONG else 3.0))
        out = tmp_path / str(seed)
        code, message = interrupted(out, signal.SIGINT, after=after)
        # A machine so fast that all was done is no failure.
        assert code in ((130,) if after < 3.0 else (130, 0)), (after, message)
        whole_files_only(out)


class FakeWriter:
    """Stands where the report's writer does, to see what the verb hands it."""

    def __init__(self, out: Path, study: object) -> None:
        self.path = out / "seen.json"
        self.seen: list[str] = []

    def add(self, name: str, outcome: object) -> None:
        assert outcome == f"outcome of {name}"
        self.seen.append(name)

    def finish(self) -> None:
        self.path.parent.mkdir(parents=True)
        self.path.write_text(json.dumps(self.seen))


@pytest.fixture
def quick(monkeypatch: pytest.MonkeyPatch) -> None:
    """Chapters that cost nothing; real ones run in the campaign of `make test-all` and in `make study`."""

    def chapters(study: object) -> object:
        return iter([(name, lambda name=name: f"outcome of {name}") for name in NAMES])

    monkeypatch.setattr("middeck.study.mission.run_chapters", chapters)
    monkeypatch.setattr("middeck.report.results_folder.StudyWriter", FakeWriter)


@pytest.mark.usefixtures("quick")
def test_every_chapter_reaches_the_writer_and_its_time_is_printed(tmp_path: Path, capfd: Capture) -> None:
    ended = middeck(capfd, "study", STUDY, "-o", tmp_path / "out", "--json")
    assert ended.code == 0
    found = json.loads(ended.out)
    assert found["schema"] == "middeck.study/1"
    assert list(found["time_s"]) == NAMES
    assert found["files"] == [(tmp_path / "out/seen.json").as_posix()]
    assert json.loads((tmp_path / "out/seen.json").read_text()) == NAMES
    lines = ended.err.splitlines()
    assert [line.rpartition("  ")[0] for line in lines] == NAMES
    assert all(line.endswith(" s") for line in lines)


@pytest.mark.usefixtures("quick")
def test_the_examples_of_study_are_understood(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    for name in ("articles", "environments", "studies", "data"):
        (tmp_path / name).symlink_to(ROOT / name)
    monkeypatch.chdir(tmp_path)
    text = middeck(capfd, "study", "--help").out.partition("Examples:\n")[2]
    examples = [line.split()[1:] for line in text.splitlines() if line.strip().startswith("middeck")]
    assert len(examples) == 2
    for arguments in examples:
        ended = middeck(capfd, *arguments)
        assert ended.code == 0
        assert "report  out/" in ended.out


def test_progress_on_a_terminal_tells_the_remaining_time(
    monkeypatch: pytest.MonkeyPatch, capfd: Capture
) -> None:
    shares: Mapping[str, float] = {"one": 0.25, "two": 0.75}
    monkeypatch.setattr("middeck.cli.shown.progress.is_terminal", lambda stream: True)
    monkeypatch.setenv("FORCE_COLOR", "1")
    monkeypatch.setenv("TERM", "xterm")
    with follow(shares) as (begin, end):
        begin("one")
        end("one", 10.0)
        begin("two")
        time.sleep(0.3)  # the bar is drawn ten times a second
        end("two", 30.0)
    drawn = capfd.readouterr().err
    assert "about 30 s left" in drawn  # 10 s for a quarter of the work
    assert "one  10.0 s" in drawn
