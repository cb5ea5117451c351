"""Packages that were changed: under the hash that they had, or sealed again, which makes others of them."""

from __future__ import annotations

import hashlib
import random
import struct
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.errors import DataError
from middeck.realtime.engine.interface.commands import ANSWERS
from middeck.realtime.engine.process.compile import engine_sources
from middeck.realtime.generate.compiler import FLAGS
from middeck.realtime.package.filter_sections import InputFilter, Section
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import decode_package, encode_package
from middeck.realtime.package.package_law import package_law
from packaged_laws import random_law

FUZZ = Path(__file__).parent / "fuzz" / "package_fuzz.c"
SANITIZED = ("-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
READER = ("package.c", "law.c", "poles.c", "sha256.c", "text.c")
HASH = 32
SECTION = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))


def small_packages() -> Iterator[ControllerPackage]:
    """Short ones, so that a change hits what matters: every form, filters, a path of applied commands."""
    rng = np.random.default_rng(4)
    given: dict[str, Any] = {"input_range": 0.1, "limit": 0.5, "ramp_s": 0.01}
    yield package_law(random_law(rng, 4, 2, 2), "modal", filters=(InputFilter(1, SECTION),), **given)
    yield package_law(random_law(rng, 3, 1, 2), "dense", form="dense", slew_rate=10.0, **given)
    yield package_law(random_law(rng, 0, 1, 1, applied=False), "gain")
    yield package_law(random_law(rng, 2, 1, 1, radii=(1.1, 1.2)), "unstable", unstable=True, **given)


def python_reads(data: bytes) -> bool:
    try:
        decode_package(data)
    except DataError:
        return False
    return True


def sealed(body: bytes) -> bytes:
    return body + hashlib.sha256(body).digest()


def accepted_by_python(packages: Sequence[bytes], count: int, *, seal: bool) -> int:
    """How many of ``count`` changed ones the reader takes; each must be the one encoding of what it says."""
    # numpy's numbers, one at a time, would take longer than the reader.
    rng, accepted = random.Random(1993), 0
    for _ in range(count):
        data = _changed(rng, rng.choice(packages), seal)
        try:
            package = decode_package(data)
        except DataError:
            continue
        assert encode_package(package) == data
        accepted += 1
    return accepted


def _changed(rng: random.Random, whole: bytes, seal: bool) -> bytes:
    """Some bytes changed, or cut; never what it was."""
    while True:
        body = bytearray(whole[:-HASH])
        for _ in range(rng.randrange(1, 4)):
            place = rng.randrange(min(len(body), 160) if rng.random() < 0.7 else len(body))
            body[place] = rng.choice((0, 1, 255, rng.randrange(256)))
        if rng.random() < 0.2:
            body = body[: rng.randrange(8, len(body))]
        if body != whole[:-HASH]:
            return sealed(bytes(body)) if seal else bytes(body) + whole[-HASH:]


def build_fuzzer(folder: Path) -> Path:
    """The engine's reader with sanitizers, and what changes packages for it."""
    for name, text in engine_sources().items():
        (folder / name).write_text(text)
    (folder / FUZZ.name).write_text(FUZZ.read_text())
    command = ["cc", *FLAGS, *SANITIZED, "-O2", FUZZ.name, *READER, "-o", "fuzz", "-lm"]
    subprocess.run(command, cwd=folder, check=True)
    return folder / "fuzz"


def told_by_engine(
    program: Path, packages: Sequence[Path], count: int, *, seal: bool, every: int
) -> Iterator[tuple[bytes, str]]:
    """Bytes and the engine's word, of ``count`` changed ones for each that it takes and one in ``every``."""
    words = [program, "1993", str(count), str(every), str(int(seal)), *packages]
    with subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE) as process:
        assert process.stdout is not None
        while head := process.stdout.read(8):
            size, answer = struct.unpack("<II", head)
            yield process.stdout.read(size), ANSWERS[answer]
        said = process.stderr.read() if process.stderr else b""
    assert process.returncode == 0, said.decode()[:3000]
