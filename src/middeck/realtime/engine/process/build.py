"""The engine's program: compiled by the C compiler of this machine, once for each state of its sources."""

from __future__ import annotations

import hashlib
import os
import platform
import shutil
import subprocess
import tempfile
from importlib import resources
from pathlib import Path

from middeck.errors import ConfigError, MiddeckError

FLAGS = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off", "-O3")
COMPILERS = ("cc", "gcc", "clang")


class NoCompilerError(MiddeckError):
    """No C compiler is at hand: the reference law in Python runs the same packages."""

    exit_code = 3


def find_compiler() -> str | None:
    """The C compiler of this machine; None where there is none. The variable CC names another."""
    named = os.environ.get("CC")
    return next(filter(None, map(shutil.which, [named] if named else COMPILERS)), None)


def build_engine(
    *, driver: str | Path | None = None, flags: tuple[str, ...] = (), folder: Path | None = None
) -> Path:
    """The engine's program, compiled into the user's cache where it is not there yet.

    ``driver`` is a C source in the form of ``rig_driver.c`` for converters of one's own, ``flags`` are
    further ones of the compiler, ``folder`` another cache. Raises `NoCompilerError` without a compiler,
    `ConfigError` for sources that do not compile.
    """
    compiler = find_compiler()
    if compiler is None:
        raise NoCompilerError(
            "no C compiler on this machine", hint="install one (cc), or run the package with ReferenceLaw"
        )
    sources = engine_sources(driver)
    known = [
        compiler,
        platform.machine(),
        *FLAGS,
        *flags,
        *(f"{name}\n{text}" for name, text in sources.items()),
    ]
    target = (
        folder or cache_folder()
    ) / f"engine-{hashlib.sha256(chr(0).join(known).encode()).hexdigest()[:24]}"
    if not target.exists():
        _compile(compiler, sources, flags, target)
    return target


def engine_sources(driver: str | Path | None = None) -> dict[str, str]:
    """Name and text of every source, the arithmetic that it shares with the generated C included."""
    room = resources.files("middeck.realtime")
    files = [f for f in room.joinpath("engine", "source").iterdir() if f.name.endswith((".c", ".h"))]
    files.append(room.joinpath("generate", "kernel.h"))
    sources = {file.name: file.read_text(encoding="utf-8") for file in sorted(files, key=lambda f: f.name)}
    if driver is not None:
        try:
            sources["rig_driver.c"] = Path(driver).read_text(encoding="utf-8")
        except OSError as error:
            raise ConfigError(
                f"cannot be read: {error.strerror}", where=str(driver), hint="a C source"
            ) from None
    return sources


def cache_folder() -> Path:
    """``middeck`` in the user's cache (XDG_CACHE_HOME, else ~/.cache)."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "middeck"


def _compile(compiler: str, sources: dict[str, str], flags: tuple[str, ...], target: Path) -> None:
    target.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=target.parent) as folder:
        for name, text in sources.items():
            (Path(folder) / name).write_text(text, encoding="utf-8")
        units = [name for name in sources if name.endswith(".c")]
        made = subprocess.run(
            [compiler, *FLAGS, *flags, *units, "-o", "engine", "-lm", "-lpthread"],
            cwd=folder,
            capture_output=True,
            text=True,
            check=False,
        )
        if made.returncode != 0:
            raise ConfigError(
                f"the engine does not compile: {made.stderr.strip()[:2000]}",
                where=compiler,
                hint="CC=another compiler",
            )
        (Path(folder) / "engine").replace(target)  # whole or not at all, whoever else compiles it
