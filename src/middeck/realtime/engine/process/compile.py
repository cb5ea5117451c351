"""The engine's program, compiled by the C compiler of this machine."""

import functools
from importlib import resources
from pathlib import Path

from middeck.errors import ConfigError
from middeck.realtime.engine.interface.header import layout_check
from middeck.realtime.generate.compiler import compile_once


def build_engine(
    *, driver: str | Path | None = None, flags: tuple[str, ...] = (), folder: Path | None = None
) -> Path:
    """The engine's program, compiled into the user's cache where it is not there yet.

    ``driver`` is a C source in the form of ``rig_driver.c`` for converters of one's own, ``flags`` are
    further ones of the compiler, ``folder`` another cache. Raises `NoCompilerError` without a compiler,
    `ConfigError` for sources that do not compile.
    """
    sources = engine_sources(driver)
    try:
        return compile_once("engine", sources, flags=flags, folder=folder)
    except ConfigError as error:
        error.where = error.where if driver is None else f"{driver} with {error.where}"
        raise


def engine_sources(driver: str | Path | None = None) -> dict[str, str]:
    """Name and text of every source, the arithmetic that it shares with the generated C included."""
    sources = dict(_own_sources())
    if driver is not None:
        try:
            sources["rig_driver.c"] = Path(driver).read_text(encoding="utf-8")
        except (OSError, UnicodeDecodeError) as error:
            why = getattr(error, "strerror", "not UTF-8 text")
            raise ConfigError(f"cannot be read: {why}", where=str(driver), hint="a C source") from None
    return sources


@functools.cache  # every start of an engine asks for them, to find its program
def _own_sources() -> dict[str, str]:
    room = resources.files("middeck.realtime")
    files = [f for f in room.joinpath("engine", "source").iterdir() if f.name.endswith((".c", ".h"))]
    files.append(room.joinpath("generate", "kernel.h"))
    found = {file.name: file.read_text(encoding="utf-8") for file in sorted(files, key=lambda f: f.name)}
    return {**found, "layout.h": f"#define LAYOUT INT64_C({layout_check()})\n"}
