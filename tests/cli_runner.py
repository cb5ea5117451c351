"""Run the command line, in this process or as its own."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from middeck.cli.fitting import identify
from middeck.cli.main import execute

ROOT = Path(__file__).parents[1]
FITTED: dict[str, Any] = {}


class Ended(NamedTuple):
    code: int
    out: str
    err: str


def middeck(capfd: pytest.CaptureFixture[str], *arguments: object) -> Ended:
    """``middeck ARGUMENTS`` in this process."""
    code = execute([str(a) for a in arguments], lambda: False)
    return Ended(code, *capfd.readouterr())


def identify_once(*asked: Any) -> Any:
    """For `middeck.cli.fitting.identify`: what examples of several verbs ask for alike is fitted once."""
    known = str(asked[:3])
    if known not in FITTED:
        FITTED[known] = identify(*asked)
    return FITTED[known]


def script(*arguments: object) -> list[str]:
    """The command that the installed script runs."""
    return [sys.executable, "-c", "from middeck.cli.main import run; run()", *map(str, arguments)]


def as_process(*arguments: object, cwd: Path = ROOT, **variables: str) -> Ended:
    """``middeck ARGUMENTS`` as a process of its own, not on a terminal."""
    done = subprocess.run(
        script(*arguments),
        capture_output=True,
        text=True,
        cwd=cwd,
        env={**os.environ, **variables},
        timeout=120,
    )
    return Ended(done.returncode, done.stdout, done.stderr)
