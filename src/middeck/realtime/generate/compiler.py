"""The C compiler of this machine, and its work: kept in a cache, once for each state of the sources."""

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from collections.abc import Mapping
from pathlib import Path

from middeck.errors import ConfigError, MiddeckError

FLAGS = ("-std=c99", "-ffp-contract=off", "-O3")
LIBRARIES = ("-lm", "-lpthread")
COMPILERS = ("cc", "gcc", "clang")


class NoCompilerError(MiddeckError):
    """No C compiler is at hand: the reference law in Python runs the same packages."""

    exit_code = 3


def find_compiler() -> str | None:
    """The C compiler of this machine; None where there is none. The variable CC names another."""
    named = os.environ.get("CC")
    return next(filter(None, map(shutil.which, [named] if named else COMPILERS)), None)


def compile_once(
    name: str, sources: Mapping[str, str], *, flags: tuple[str, ...] = (), folder: Path | None = None
) -> Path:
    """What the ``.c`` among ``sources`` (text by file name) make, compiled where it is not there yet.

    ``flags`` are further ones of the compiler, ``folder`` another cache than the user's. Raises
    `NoCompilerError` without a compiler, `ConfigError` for sources that do not compile, `OSError` and
    `RuntimeError` where there is no room or no home for them.
    """
    compiler = find_compiler()
    if compiler is None:
        raise NoCompilerError(
            "no C compiler on this machine", hint="install one (cc), or run the package with ReferenceLaw"
        )
    texts = (f"{file}\n{text}" for file, text in sources.items())
    known = "\0".join((compiler, platform.machine(), *FLAGS, *flags, *texts))
    target = (folder or cache_folder()) / f"{name}-{hashlib.sha256(known.encode()).hexdigest()[:24]}"
    if not target.exists():
        _compile(compiler, sources, flags, target)
    return target


def cache_folder() -> Path:
    """``middeck`` in the user's cache (XDG_CACHE_HOME, else ~/.cache)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "middeck"


def _compile(compiler: str, sources: Mapping[str, str], flags: tuple[str, ...], target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        units = [name for name in sources if name.endswith(".c")]
        made = subprocess.run(
            [compiler, *FLAGS, *flags, *units, "-o", "made", *LIBRARIES],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode != 0:
            raise ConfigError(
                f"does not compile: {made.stderr.strip()[:2000]}",
                where=compiler,
                hint="CC=another compiler",
            )
        (Path(folder) / "made").replace(target)  # whole or not at all, whoever else compiles it
