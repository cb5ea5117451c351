"""The engine's reader takes no package that Python refuses, whatever bytes it is given, and says why."""

from __future__ import annotations

import collections
import dataclasses
import itertools
import os
import re
import struct
import subprocess
from importlib.resources import files

import numpy as np
import pytest

from engine_campaigns import cases_of
from engine_cases import plain_settings, random_article, random_package
from fuzzed_packages import build_fuzzer, python_reads, sealed, small_packages, told_by_engine
from middeck.errors import DataError
from middeck.realtime.engine.interface.header import layout
from middeck.realtime.engine.interface.shared_file import STAGING
from middeck.realtime.engine.process.compile import engine_sources
from middeck.realtime.package.filter_sections import LoopPath, Section
from middeck.realtime.package.package_bytes import decode_package, encode_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.shown_characters import SHOWN
from middeck.realtime.package.single_precision import to_single
from packaged_laws import random_law
from repeats import LONG
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
SECTION = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))


@pytest.fixture(scope="module")
def fuzzer(tmp_path_factory):
    """The program and its corpus."""
    folder = tmp_path_factory.mktemp("fuzz")
    files = []
    for package in small_packages():
        files.append(folder / f"{package.name}.mdk")
        files[-1].write_bytes(encode_package(package))
    return build_fuzzer(), files


def test_no_change_crashes_the_reader_or_passes_it(fuzzer):
    """Sealed again, what it accepts is another package for Python too; of the others a sample is compared."""
    count = cases_of("changed packages sealed again, the engine's reader")
    sample = 20_000 if LONG else 200
    words, stricter = collections.Counter(), collections.Counter()
    for data, word in told_by_engine(*fuzzer, count, seal=True, every=count // sample):
        words[word] += 1
        if word == "done":
            assert python_reads(data)
        elif python_reads(data):
            stricter[word] += 1
    assert words["done"] > count // 5000
    assert len(words) >= 12, words
    # The reader alone replays the test vectors.
    assert set(stricter) <= {"bad vectors"}, stricter


def test_no_change_passes_under_the_hash_before_it(fuzzer):
    count = cases_of("changed packages under their own hash, the engine's reader")
    words = collections.Counter(word for _, word in told_by_engine(*fuzzer, count, seal=False, every=100))
    assert words["done"] == 0
    assert sum(words.values()) == count // 100
    assert words["bad hash"] > 0.5 * count // 100


def changed(at, form, value):
    body = bytearray(encode_package(random_package())[:-32])
    struct.pack_into(form, body, at, value)
    return sealed(bytes(body))


def first_number():
    """Where the first range stands, 0.1; the states of this package begin after ranges and limits."""
    data = encode_package(random_package())
    return next(k for k in range(64, len(data), 8) if struct.unpack_from("<d", data, k)[0] == 0.1)


def undeclared():
    law = random_law(np.random.default_rng(1), 4, 3, 2, radii=(1.01, 1.02))
    data = encode_package(package_law(law, "law", form="dense", unstable=True))
    flags = struct.unpack_from("<I", data, 12)[0]
    return sealed(data[:12] + struct.pack("<I", flags & ~4) + data[16:-32])


def own_commands():
    data = encode_package(random_package())
    return sealed(data[:12] + struct.pack("<I", struct.unpack_from("<I", data, 12)[0] | 16) + data[16:-32])


def renamed(**changes):
    package = random_package()
    ports = tuple(dataclasses.replace(port, **changes) for port in package.inputs[:1]) + package.inputs[1:]
    return encode_package(dataclasses.replace(package, inputs=ports))


def of_rate():
    return encode_package(dataclasses.replace(random_package(), period_s=0.004))


def replayed():
    """Vectors of another law under this law: sealed, but not what it gives."""
    package, other = random_package(), random_package(seed=7)
    return encode_package(dataclasses.replace(package, vectors=other.vectors))


def twice():
    data = encode_package(random_package())
    return sealed(data[:-32].replace(b"y1", b"y0", 1))


def strange():
    """An Arabic digit, which Python can print."""
    data = encode_package(random_package())
    return sealed(data[:-32].replace(b"y1", "\u0660".encode(), 1))


WHOLE = encode_package(random_package())
# Builder; the engine's word; what Python's reader says, or None where only what follows it can know.
BROKEN = {
    "empty": (b"", "no bytes", "is empty"),
    "another file": (b"PK\x03\x04" + WHOLE[4:], "bad magic", "begins otherwise"),
    "cut to its head": (WHOLE[:40], "cut short", "cut short"),
    "truncated": (WHOLE[:-8], "cut short", "cut short"),
    "truncated in a word": (WHOLE[:-3], "cut short", "cut short"),
    "truncated and sealed": (sealed(WHOLE[:-40]), "bad length", "wrong size"),
    "a byte more": (WHOLE + b"\0", "bad hash", "was changed"),
    "a body more": (sealed(WHOLE[:-32] + bytes(8)), "too long", "not the one encoding"),
    "corrupted": (WHOLE[:300] + bytes([WHOLE[300] ^ 1]) + WHOLE[301:], "bad hash", "was changed"),
    "wrong endianness": (changed(8, ">I", 1), "other byte order", "other order"),
    "a later format": (changed(8, "<I", 2), "bad format", "format 2"),
    "wrong size": (changed(16, "<I", 40), "bad length", "wrong size"),
    "too many states": (changed(16, "<I", 70_000), "bad size", "states 70000"),
    "a bound of rounding in double": (own_commands(), "bad size", "a bound of rounding"),
    "a NaN coefficient": (changed(first_number() + 8 * 9, "<d", np.nan), "bad number", "not finite"),
    "a NaN limit": (changed(first_number() + 8 * 4, "<d", np.nan), "bad limit", "limits"),
    "an undeclared pole": (undeclared(), "undeclared pole", "undeclared pole"),
    "a name twice": (twice(), "name twice", "two inputs of one name"),
    "a character that few computers show": (strange(), "bad text", "the name"),
    "another name": (renamed(name="other"), "unknown port", None),
    "another unit": (renamed(unit="deg"), "unknown port", None),
    "another rate": (of_rate(), "other rate", None),
    "replayed vectors": (replayed(), "bad vectors", None),
}  # fmt: skip


def test_what_is_broken_is_refused_with_its_reason():
    """By the reader in Python and by LOAD, which goes on to take the whole one; the user is told why."""
    with Supervisor(plain_settings(), random_article()) as engine:
        for name, (data, word, reason) in BROKEN.items():
            answer = engine.load(data)
            assert (name, answer.word) == (name, word)
            assert answer.reason
            assert engine.command("standby").word == "not loaded"
            if reason is None:
                decode_package(data)
            else:
                with pytest.raises(DataError, match=reason):
                    decode_package(data)
        kinds = [event.kind for event in engine.events()]
        assert kinds == ["refused"] * len(BROKEN)
        assert engine.load(WHOLE).done


def test_what_only_small_processors_run_is_refused():
    law = random_law(np.random.default_rng(4), 4, 3, 2)
    paths = (LoopPath(0, 1, SECTION),)
    inner = package_law(law, "law")
    inner = dataclasses.replace(inner, paths=paths, vectors=None)
    from middeck.realtime.package.vectors import add_test_vectors

    with Supervisor(plain_settings(), random_article()) as engine:
        small = to_single(package_law(law, "s", input_range=1.0, limit=1.0))
        assert engine.load(small).word == "single precision"
        assert engine.load(add_test_vectors(inner, 6)).word == "inner loop"
        assert engine.command("load", values=[np.nan]).word == "bad length"
        assert engine.command("load", values=[1e300]).word == "bad length"
        assert engine.command("load", slot=2, values=[10.0]).word == "wrong slot"


def test_both_readers_know_the_same_characters():
    """A name that the gate passed was refused by the engine: an emoji, a Roman numeral."""
    source = (files("middeck.realtime.engine") / "source" / "text.c").read_text()
    blocks = [tuple(int(c, 16) for c in both) for both in re.findall(r"\{(0x\w+), (0x\w+)\}", source)]
    alone = [int(c, 16) for c in re.findall(r"c == (0x\w+)", source)]
    assert (*blocks, *((c, c) for c in alone)) == SHOWN
    assert all(chr(c).isprintable() for first, last in SHOWN for c in range(first, last + 1))


@pytest.mark.parametrize("form", ["modal", "dense"])
def test_poles_are_judged_as_eigenvalues_are(form):
    """Magnitudes just inside and outside, in coordinates that hide them; an integrator passes."""
    with Supervisor(plain_settings(), random_article()) as engine:
        for seed, radius in itertools.product(range(4), (0.9, 1.0 - 1e-6, 1.0, 1.0 + 1e-6, 1.1)):
            law = random_law(np.random.default_rng(seed), 12, 3, 2, radii=(radius, radius))
            data = encode_package(package_law(law, "law", form=form, unstable=True, limit=0.5))
            flags = struct.unpack_from("<I", data, 12)[0]
            data = sealed(data[:12] + struct.pack("<I", flags & ~4) + data[16:-32])
            assert engine.load(data).word == ("undeclared pole" if radius > 1.0 else "done")
            assert python_reads(data) == (radius <= 1.0)


def test_no_shared_file_crashes_the_engine(tmp_path, sanitized_engine):
    """Places, settings, article and the supervisor's words: refused with code 2 or 3 and a reason, or run."""
    rng, codes = np.random.default_rng(5), collections.Counter()
    # It takes no memory that could leak, and looking for leaks is most of what a short run takes.
    assert not [name for name, text in engine_sources().items() if "alloc(" in text or "strdup(" in text]
    unleaking = {**os.environ, "ASAN_OPTIONS": "detect_leaks=0"}
    with Supervisor(plain_settings(), random_article(), ring=64, pretrip_s=0.1) as engine:
        engine.file.asks["until"] = 0
        path = engine.file.path
        places = {name: int(engine.file.places[name]) for name in engine.file.places.dtype.names}
        whole = path.read_bytes()[: places["staging"]]
    regions = [
        (0, 200),
        (places["settings"], 200),
        (places["settings"], places["article"] - places["settings"]),
    ]
    regions += [(places["article"], places["article_numbers"] - places["article"]), (places["asks"], 40)]
    ramp_at = layout("settings").fields["safe_ramp"][1]
    parent_at = places["asks"] + layout("asks").fields["supervisor"][1]
    values = [0, 1, -1, 2, 63, 64, 65, 255, 1 << 31, 1 << 62, -(1 << 62), 8, 7]
    for _ in range(cases_of("changed shared files, an engine started on each")):
        data = bytearray(whole)
        struct.pack_into("<q", data, parent_at, 1)  # not its parent: it ends by itself
        struct.pack_into("<q", data, places["asks"], 20)
        for _ in range(rng.integers(1, 4)):
            start, size = regions[rng.integers(len(regions))]
            at = start + 8 * int(rng.integers(size // 8))
            if rng.random() < 0.6:
                struct.pack_into("<q", data, at, values[rng.integers(len(values))])
            else:
                data[at : at + 8] = struct.pack("<d", [np.nan, np.inf, -1.0, 1e300][rng.integers(4)])
        (until,) = struct.unpack_from("<q", data, places["asks"])
        struct.pack_into("<q", data, places["asks"], max(-1, min(until, 100)))
        (tmp_path / "engine.shared").write_bytes(data)
        with (tmp_path / "engine.shared").open("r+b") as file:
            file.truncate(len(whole) + STAGING)
        clock, rig = struct.unpack_from("<qq", data, places["settings"] + 16)
        ramp = struct.unpack_from("<q", data, places["settings"] + ramp_at)[0]
        if clock == 1 or rig == 1 or ramp > 10_000:
            continue  # it would run on, wait for another process, or take long to end
        done = subprocess.run(
            [str(sanitized_engine), str(tmp_path / "engine.shared")], capture_output=True, text=True,
            check=False, timeout=30, env=unleaking,
        )  # fmt: skip
        assert done.returncode in (0, 2, 3), done.stderr[:3000]
        assert (done.returncode == 0) == (not done.stderr)
        codes[done.returncode] += 1
    assert codes[0]
    assert codes[2]
