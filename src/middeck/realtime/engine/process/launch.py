"""How an engine is started, and with what: its rig, its excitation, and the words of its shared file."""

from __future__ import annotations

import contextlib
import math
import re
import subprocess
from collections.abc import Collection, Generator
from importlib import resources
from pathlib import Path

import numpy as np
from jaxtyping import Int

from middeck.errors import ConfigError, DataError
from middeck.realtime.engine.interface.header import constants, layout
from middeck.realtime.engine.interface.settings import EngineSettings, encode_settings
from middeck.realtime.engine.interface.shared_file import SharedFile, process_of
from middeck.realtime.engine.process.adopted_engine import AdoptedEngine, runs_engine
from middeck.realtime.engine.rigs.linear_article import LinearArticle
from middeck.realtime.generate.compiler import compile_once
from middeck.values import record


@record
class UdpRig:
    """A rig that answers on this port of the loopback interface.

    Raises `ConfigError` for what is no port.
    """

    port: int

    def __post_init__(self) -> None:
        if not isinstance(self.port, (int, np.integer)) or not 0 < self.port < 1 << 16:
            raise ConfigError(f"port {self.port!r}", where="UdpRig", hint="a whole number from 1 to 65535")


@record
class DriverRig:
    """Converters behind the driver that the engine was built with."""


LEFT: list[subprocess.Popen[str] | AdoptedEngine] = []
"""Engines that run on under another supervisor; those that have ended are buried at the next start."""
RigChoice = LinearArticle | UdpRig | DriverRig
CHOSEN_AT_START = ("clock", "rig", "port")


def no_article() -> tuple[np.ndarray, np.ndarray]:
    """The shared record of an article that is elsewhere, and its numbers."""
    return np.zeros((), layout("article")), np.zeros(0)


def started_settings(settings: EngineSettings, rig: RigChoice, real_time: bool) -> np.ndarray:
    """The shared record with clock and rig; raises `ConfigError` for an article with other ports."""
    words, kinds = encode_settings(settings), constants()
    words["clock"] = kinds["REAL_TIME" if real_time else "LOCKSTEP"]
    if isinstance(rig, LinearArticle):
        shape = rig.C.shape[0], rig.B.shape[1]
        if shape != (len(settings.sensors), len(settings.drives)):
            raise ConfigError(
                f"an article of {shape[0]} sensors and {shape[1]} outputs for an engine of "
                f"{len(settings.sensors)} and {len(settings.drives)}",
                hint="the same ports in the same order",
            )
        words["rig"] = kinds["LINEAR_RIG"]
    elif isinstance(rig, UdpRig):
        words["rig"], words["port"] = kinds["UDP_RIG"], rig.port
    else:
        words["rig"] = kinds["DRIVER_RIG"]
    return words


def is_run_by(settings: EngineSettings, words: np.ndarray) -> bool:
    """Whether an engine with these words was started with ``settings``."""
    own = encode_settings(settings)
    for name in CHOSEN_AT_START:
        own[name] = words[name]
    return own.tobytes() == words.tobytes()


def banned_hashes(blacklist: Collection[str]) -> bytes:
    """The hashes as they are shared; raises `ConfigError` for what is none, and for too many."""
    most = constants()["HASHES"] - constants()["SLOTS"]
    if len(blacklist) > most:
        raise ConfigError(f"a blacklist of {len(blacklist)} laws", hint=f"{most} at most")
    wrong = [text for text in blacklist if not re.fullmatch("[0-9a-f]{64}", text)]
    if wrong:
        raise ConfigError(f"no SHA-256 on the blacklist: {wrong[0]!r}", hint="64 hexadecimal digits")
    return b"".join(map(bytes.fromhex, blacklist))


def checked_waveform(waveform: np.ndarray, settings: EngineSettings) -> np.ndarray:
    """``waveform`` as it is shared; raises `ConfigError` for one that does not fit."""
    w = np.ascontiguousarray(waveform, dtype=float)
    if w.ndim != 2 or w.shape[1] != len(settings.drives) or not np.isfinite(w).all():
        raise ConfigError(
            f"an excitation of shape {w.shape}",
            hint=f"finite, one column for each of {len(settings.drives)} outputs",
        )
    if not math.prod(w.shape):
        raise ConfigError("an excitation without a sample", hint="at least one")
    return w


def require_no_engine(path: Path) -> None:
    """A new shared file takes the place of an old one, not of one that a loop has mapped."""
    pid, born = process_of(path)
    if runs_engine(pid, born, path):
        raise ConfigError(
            f"an engine runs there, process {pid}",
            where=str(path),
            hint="another folder, or Supervisor.attach",
        )


def launch(program: Path, file: SharedFile) -> subprocess.Popen[str]:
    """The engine's process; raises `DataError` for a program that this system does not start."""
    LEFT[:] = [child for child in LEFT if child.poll() is None]
    with _told_of(program):
        return subprocess.Popen(
            [str(program), str(file.path.resolve())],
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,  # an orphan must not keep its supervisor's pipes open
            stderr=subprocess.PIPE,
            text=True,
        )


@contextlib.contextmanager
def _told_of(program: Path) -> Generator[None]:
    try:
        yield
    except OSError as error:
        raise DataError(
            f"the compiled program does not start: {error.strerror}",
            where=str(program),
            hint="delete the file, it is compiled anew; or set XDG_CACHE_HOME to a disk that allows programs",
        ) from error


def run_bare_loop(settings: EngineSettings, samples: int, numbers: int) -> Int[np.ndarray, "2 sample"]:
    """Lateness of a loop that only reads ``numbers`` at each tick, and its time for that [ns].

    Raises `DataError` where this machine does not start it or run it to its end.
    """
    source = resources.files("middeck.realtime.engine.process").joinpath("bare_loop.c").read_text("utf-8")
    program, words = compile_once("bare_loop", {"bare_loop.c": source}), encode_settings(settings)
    asked = (round(1e9 * settings.period_s), samples, numbers, words["priority"], words["processor"])
    with _told_of(program):
        done = subprocess.run([str(program), *map(str, asked)], capture_output=True, check=False)
    if done.returncode != 0:
        said = done.stderr.decode(errors="replace").strip()
        raise DataError(
            f"the bare loop has ended with code {done.returncode}: {said}",
            where="timing beside the engine",
            hint="fewer samples (16 bytes of memory each), no priority",
        )
    return np.frombuffer(done.stdout, "<i8").reshape(-1, 2).T
