"""Packages that were changed: under the hash that they had, or sealed again, which makes others of them."""

from __future__ import annotations

import contextlib
import hashlib
import json
import random
import struct
import subprocess
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from middeck.errors import DataError, MiddeckError
from middeck.files.json.output import json_text
from middeck.files.laws.packages import _build as twin_package
from middeck.files.laws.packages import load_package, package_document
from middeck.realtime.engine.interface.commands import ANSWERS
from middeck.realtime.engine.process.compile import engine_sources
from middeck.realtime.generate.compiler import compile_once
from middeck.realtime.package.filter_sections import InputFilter, Section
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_bytes import decode_package, encode_package, hash_package
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


VALUES = (
    0,
    1,
    -1,
    2**70,
    0.0,
    -0.0,
    0.5,
    1e308,
    float("inf"),
    float("nan"),
    True,
    None,
    "x",
    "double",
    [],
    {},
    [[]],
)


def accepted_twins(file: Path, packages: Sequence[ControllerPackage], count: int, *, seal: bool) -> int:
    """How many of ``count`` changed JSON twins the reader takes.

    Some characters changed, or cut, must leave the package that it was, as "1.0" and "1.00" are one number.
    With ``seal`` some values, keys or entries are others, under the hash of what then stands there: what is
    taken must be that.
    """
    rng, accepted = random.Random(1993), 0
    twins = [(package, json_text(package_document(package))) for package in packages]
    for _ in range(count):
        package, text = rng.choice(twins)
        changed = _other_document(rng, text) if seal else _other_text(rng, text)
        file.write_text(changed, encoding="utf-8")
        try:
            found = load_package(file)
        except DataError:
            continue
        if seal:  # numbers by their values: 1 and 1.0 are one
            written = json_text(package_document(found))
            assert _in_order(changed) == _in_order(written), changed
        else:
            assert found == package
        accepted += 1
    return accepted


def _in_order(text: str) -> str:
    return json.dumps(json.loads(text, parse_int=float), sort_keys=True)


def _other_text(rng: random.Random, text: str) -> str:
    body = list(text)
    for _ in range(rng.randrange(1, 4)):
        body[rng.randrange(len(body))] = rng.choice('0123456789.-+e,:[]{}" nul\\')
    return "".join(body[: rng.randrange(len(body))] if rng.random() < 0.2 else body)


def _other_document(rng: random.Random, text: str) -> str:
    document = json.loads(text)
    for _ in range(rng.randrange(1, 3)):
        table: Any = document
        while True:  # down to a place anywhere
            keys = list(table) if isinstance(table, dict) else range(len(table))
            key = rng.choice(keys) if len(keys) else None
            inner = None if key is None else table[key]
            if not (isinstance(inner, (dict, list)) and len(inner) and rng.random() < 0.8):
                break
            table = inner
        if key is None or (isinstance(table, list) and rng.random() < 0.1):
            table.append(rng.choice(VALUES)) if isinstance(table, list) else table.update(other=1)
        elif rng.random() < 0.15:
            del table[key]
        elif type(inner) is float and rng.random() < 0.5:
            table[key] = inner * rng.choice((1.0 + 2.0**-52, -1.0, 2.0, 0.5))
        else:
            table[key] = rng.choice(VALUES)
    with contextlib.suppress(MiddeckError, ValueError, TypeError, OverflowError, KeyError):
        document["sha256"] = hash_package(twin_package(document, ""))
    return json.dumps(document)


def build_fuzzer() -> Path:
    """The engine's reader with sanitizers, and what changes packages for it; compiled once."""
    used = {name: text for name, text in engine_sources().items() if name.endswith(".h") or name in READER}
    return compile_once("fuzz", {**used, FUZZ.name: FUZZ.read_text()}, flags=(*SANITIZED, "-O2"))


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
