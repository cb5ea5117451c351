"""Where the command runs: odd paths, no home, no network, no compiler, and nothing but its package."""

from __future__ import annotations

import json
import os
import subprocess
import sys
import zipfile
from pathlib import Path

import pytest

from cli_runner import ROOT, middeck

DM = ROOT / "articles/mace-dm.toml"
Capture = pytest.CaptureFixture[str]
WORDS = {"py", "pyi", "typed", "c", "h", "in", "html", "j2", "js", "json", "md", "toml"}
"""What a wheel may hold: code, forms of pages and of C, and a study to start from."""
SCHEMA = "middeck/study/numbers.schema.json"


def alone(code: str, cwd: Path, **variables: str) -> subprocess.CompletedProcess[str]:
    """A Python of its own that knows no environment but ``variables``."""
    threads = dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
    return subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, cwd=cwd, env={**threads, **variables}
    )


def test_an_article_of_ones_own_far_from_the_project_in_orbit(
    tmp_path: Path, capfd: Capture, monkeypatch: pytest.MonkeyPatch
) -> None:
    (tmp_path / "tower.toml").write_text(DM.read_text(encoding="utf-8"), encoding="utf-8")
    monkeypatch.chdir(tmp_path)
    ended = middeck(capfd, "modes", "tower.toml", "--environment", "orbit", "--json")
    assert (ended.code, ended.err) == (0, "")
    assert json.loads(ended.out)["kind"][:9] == ["rigid"] * 8 + ["flexible"]


def test_paths_with_spaces_and_letters_of_any_language(tmp_path: Path, capfd: Capture) -> None:
    folder = tmp_path / "Prüfstand 试验 1"
    folder.mkdir()
    article = folder / "mât à deux.toml"
    article.write_text(DM.read_text(encoding="utf-8"), encoding="utf-8")
    law = folder / "läw 1.json"
    ports = ("--control", "pri_rel_z", "--measure", "pri_in_z", "--count", 12)
    lab = ROOT / "environments/lab.toml"
    ended = middeck(capfd, "design", article, "--environment", lab, *ports, "-o", law)
    assert ended.code == 0, ended.err
    assert json.loads(law.read_text(encoding="utf-8"))["schema"] == "middeck.compensator/1"


def test_a_study_whose_folder_is_a_file(tmp_path: Path, capfd: Capture) -> None:
    blocked = tmp_path / "out"
    blocked.write_text("keep")
    ended = middeck(capfd, "study", ROOT / "studies/mace-1993.toml", "-o", blocked)
    assert (ended.code, ended.out) == (2, "")
    assert str(blocked) in ended.err
    assert blocked.read_text() == "keep"


ALONE = """
import socket

class Denied(socket.socket):
    def __init__(self, *arguments, **more):
        raise AssertionError("a socket was opened")

def denied(*arguments, **more):
    raise AssertionError("the network was asked")

socket.socket = Denied
socket.create_connection = socket.getaddrinfo = denied

from middeck.cli.main import execute

code = execute(["modes", {article!r}, "--environment", "orbit", "--count", "9"], lambda: False)
raise SystemExit(code)
"""


def test_no_network_no_compiler_and_no_home(tmp_path: Path) -> None:
    """An empty PATH holds no compiler; no HOME, no cache; sockets fail when they are made."""
    ended = alone(ALONE.format(article=str(DM)), tmp_path, PATH=str(tmp_path))
    assert ended.returncode == 0, ended.stderr
    assert "translation x" in ended.stdout
    assert ended.stderr == ""


def test_the_wheel_holds_the_package_and_no_data(tmp_path: Path) -> None:
    pytest.importorskip("hatchling")
    build = [sys.executable, "-m", "hatchling", "build", "-t", "wheel", "-d", str(tmp_path)]
    done = subprocess.run(build, capture_output=True, text=True, cwd=ROOT, env={**os.environ})
    assert done.returncode == 0, done.stderr
    (wheel,) = tmp_path.glob("*.whl")
    size = {file.filename: file.file_size for file in zipfile.ZipFile(wheel).infolist()}
    names, own = list(size), [name for name in size if name.startswith("middeck/")]
    assert {name.rpartition(".")[2] for name in own} == WORDS
    assert [name for name in own if name.endswith(".json")] == [SCHEMA]
    assert max(size[name] for name in own if name != SCHEMA) < 32_000
    assert all(n.startswith(("middeck/", "middeck-")) for n in names)
    for needed in ("report/report.html.j2", "files/orbit.toml", "py.typed"):
        assert f"middeck/{needed}" in names
    assert wheel.stat().st_size < 5_000_000
