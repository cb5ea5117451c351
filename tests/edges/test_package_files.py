"""Packages on disk: what is written is read back, and nothing else is taken for a package."""

from __future__ import annotations

import dataclasses
import json
import re
import struct

import numpy as np
import pytest

from cli_runner import middeck
from engine_campaigns import cases_of
from fuzzed_packages import accepted_by_python, accepted_twins, sealed, small_packages
from middeck.errors import ConfigError, DataError, MiddeckError
from middeck.files.laws.compensators import load_compensator, write_compensator
from middeck.files.laws.packages import load_package, write_package
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.package_bytes import decode_package, encode_package, hash_package
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.single_precision import to_single
from middeck.realtime.package.vectors import add_test_vectors
from packaged_laws import random_law
from repeats import repeats

SECTION = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))


def whole():
    """A package with something in every field."""
    law = random_law(np.random.default_rng(1), 7, 2, 2)
    package = package_law(
        law, "law-7", input_range=0.1, limit=[0.5, np.inf], slew_rate=[10.0, np.inf], ramp_s=0.01,
        filters=(InputFilter(1, SECTION),),
    )  # fmt: skip
    return add_test_vectors(dataclasses.replace(package, paths=(LoopPath(0, 1, SECTION),)), 6)


def own():
    """In single precision, with a bound for its own commands only."""
    law = random_law(np.random.default_rng(1), 4, 2, 1)
    law = dataclasses.replace(law, applied=200.0 * law.applied)
    return to_single(package_law(law, "o", input_range=0.01, limit=9.0))


PACKAGES = {
    "whole": whole,
    "dense": lambda: package_law(random_law(np.random.default_rng(2), 4, 1, 1), "d", form="dense"),
    "gain": lambda: package_law(random_law(np.random.default_rng(3), 0, 1, 2, applied=False), "g"),
    "single": lambda: to_single(
        package_law(random_law(np.random.default_rng(4), 4, 2, 1), "s", input_range=1.0, limit=9.0)
    ),
    "own": own,
}


@pytest.mark.parametrize("ending", ["mdk", "json"])
@pytest.mark.parametrize("name", PACKAGES)
def test_what_is_written_is_read_back(name, ending, tmp_path):
    package, file = PACKAGES[name](), tmp_path / f"law.{ending}"
    assert write_package(file, package) == (file,)
    found = load_package(file)
    assert found == package
    assert hash_package(found) == hash_package(package)
    assert encode_package(found) == encode_package(package)


DATA = encode_package(whole())


def patched(at: int, form: str, value: float) -> bytes:
    body = bytearray(DATA[:-32])
    struct.pack_into(form, body, at, value)
    return sealed(bytes(body))


# Words of the head stand from byte 8: format, flags, states, pairs, inputs, outputs, filters, paths, ...
BROKEN = {
    "empty": (b"", "is empty"),
    "another file": (b"PK\x03\x04" + DATA[4:], "archive of arrays"),
    "cut to its head": (DATA[:40], "cut short"),
    "truncated": (DATA[:-1], "cut short"),
    "a byte more": (DATA + b"\0", "was changed"),
    "corrupted": (DATA[:300] + bytes([DATA[300] ^ 1]) + DATA[301:], "was changed"),
    "wrong endianness": (sealed(DATA[:8] + DATA[8:12][::-1] + DATA[12:-32]), "other order"),
    "a later format": (patched(8, "<I", 2), "format 2"),
    "an unknown flag": (patched(12, "<I", 32), "flags 32"),
    "a bound for own commands in double": (patched(12, "<I", 9 + 16), "a bound of rounding"),
    "another flag": (patched(12, "<I", 9 + 2), "."),
    "too many states": (patched(16, "<I", 70_000), "states 70000"),
    "more states than bytes": (patched(16, "<I", 1000), "wrong size"),
    "more blocks than states": (patched(20, "<I", 200), "200 blocks"),
    "no inputs": (patched(24, "<I", 0), "0 inputs"),
    "no outputs": (patched(28, "<I", 0), "0 outputs"),
    "one output less": (patched(28, "<I", 1), "."),
    "a reserved word": (patched(52, "<I", 1), "reserved 1"),
    "a period of zero": (patched(56, "<d", 0.0), "period of 0.0"),
    "a period that is none": (patched(56, "<d", np.nan), "period of nan"),
    "a body more": (sealed(DATA[:-32] + bytes(8)), "not the one encoding"),
}  # fmt: skip


@pytest.mark.parametrize("name", BROKEN)
def test_what_is_broken_is_refused_with_its_reason(name, tmp_path):
    data, reason = BROKEN[name]
    (tmp_path / "law.mdk").write_bytes(data)
    with pytest.raises(DataError, match=reason) as refused:
        load_package(tmp_path / "law.mdk")
    assert "law.mdk" in str(refused.value)


def number_places() -> list[int]:
    """Where the doubles of the package stand."""
    first = next(k for k in range(64, len(DATA), 8) if struct.unpack_from("<d", DATA, k)[0] == 0.1)
    return list(range(first, len(DATA) - 40, 8))


@pytest.mark.parametrize("value", repeats([np.nan, np.inf, -np.inf], 2))
def test_no_coefficient_may_be_other_than_finite(value):
    """Limits may be infinite, to their side; nothing may be NaN."""
    limits = 2 + 3 * 2
    for k, place in enumerate(number_places()):
        if k < limits and np.isinf(value):
            continue
        with pytest.raises(DataError):
            decode_package(patched(place, "<d", value))


def test_any_changed_bit_is_refused():
    """Each of them: all of a package is sealed."""
    for place in range(8 * len(DATA)):
        data = bytearray(DATA)
        data[place // 8] ^= 1 << (place % 8)
        with pytest.raises(DataError):
            decode_package(bytes(data))


def test_fuzzed_packages_neither_crash_nor_lie():
    """Sealed again they are refused, or other packages, each the one encoding of what it says."""
    whole = [encode_package(make()) for make in PACKAGES.values()]
    count = cases_of("changed packages sealed again, the reader in Python")
    assert 0 < accepted_by_python(whole, count, seal=True) < count


def test_no_change_passes_under_the_hash_before_it():
    whole = [encode_package(make()) for make in PACKAGES.values()]
    count = cases_of("changed packages under their own hash, the reader in Python")
    assert accepted_by_python(whole, count, seal=False) == 0


def test_no_change_of_a_twin_passes_under_its_hash(tmp_path):
    """But what leaves every value as it was, as zeros behind a number do."""
    count = cases_of("changed JSON twins under their own hash")
    taken = accepted_twins(tmp_path / "law.json", list(small_packages()), count, seal=False)
    assert 0 < taken < count // 20


def test_a_twin_sealed_again_is_refused_or_the_package_that_it_says(tmp_path):
    """No crash; of the values that stand there none is read as another, as a name 0.5 was as "0.5"."""
    count = cases_of("changed JSON twins sealed again")
    taken = accepted_twins(tmp_path / "law.json", list(small_packages()), count, seal=True)
    assert count // 100 < taken < count // 2


def test_a_changed_twin_is_refused(tmp_path):
    file = tmp_path / "law.json"
    write_package(file, whole())
    document = json.loads(file.read_text())
    changes = [
        {"period_s": 0.004}, {"period_s": "0.002"}, {"A": 3}, {"A": [[1.0]]}, {"inputs": []}, {"pairs": 2.0},
        {"lower": [0.0, 0.0]}, {"upper": [None, "x"]}, {"name": "*/"}, {"filters": [{}]}, {"paths": {}},
        {"vectors": {}}, {"unstable": 1}, {"extra": 1}, {"sha256": "0" * 64}, {"ramp_samples": 10**30},
        {"slew_per_sample": [1e999, None]}, {"precision": "half"}, {"B": [[[1.0]]]}, {"D": None},
    ]  # fmt: skip
    for change in changes:
        file.write_text(json.dumps(document | change))
        with pytest.raises(DataError):
            load_package(file)
    for key in document:
        file.write_text(json.dumps({k: v for k, v in document.items() if k != key}))
        with pytest.raises(DataError):
            load_package(file)
    text = json.dumps(document)
    numbers = [found.span() for found in re.finditer(r"(?<=[\[ ])-?\d[\d.e+-]*(?=[],}])", text)]
    assert len(numbers) > 100
    for start, end in numbers[::2]:
        other = "2" if text[start:end] == "1" else "1"
        file.write_text(text[:start] + other + text[end:])
        with pytest.raises(DataError):
            load_package(file)
    file.write_text(text[:-1] + ', "name": "law-7"}')
    with pytest.raises(DataError, match="twice"):
        load_package(file)
    file.write_text(text)
    assert load_package(file) == whole()


def test_packages_that_do_not_fit_together():
    law = random_law(np.random.default_rng(1), 4, 2, 2)
    for given, reason in [
        ({"limit": [1.0]}, "1 limits for 2"),
        ({"limit": 0.0}, "limits from"),
        ({"input_range": -1.0}, "ranges of"),
        ({"slew_rate": np.nan}, "slew limits"),
        ({"ramp_s": -1.0}, "a ramp of"),
        ({"ramp_s": np.nan}, "a ramp of"),
        ({"form": "other"}, "no form"),
        ({"filters": (InputFilter(2, SECTION),)}, "section at input 2"),
        ({"filters": (InputFilter(0.5, SECTION),)}, r"section at input 0\.5"),
        ({"input_range": "far"}, "ranges: "),
        ({"limit": 1j}, "limits: "),
        ({"name": "no name"}, "the name"),
    ]:
        with pytest.raises(ConfigError, match=reason):
            package_law(law, **({"name": "law"} | given))
    with pytest.raises(ConfigError, match="test samples"):
        add_test_vectors(package_law(law, "law"), 2)
    with pytest.raises(ConfigError, match="no writer"):
        write_package("law.bin", package_law(law, "law"))


def test_a_compensator_keeps_its_path_in_its_file(tmp_path):
    law, file = random_law(np.random.default_rng(1), 4, 2, 3), tmp_path / "law.json"
    write_compensator(file, law)
    assert np.array_equal(load_compensator(file).applied, law.applied)
    document = json.loads(file.read_text())
    file.write_text(json.dumps(document | {"applied": np.transpose(law.applied).tolist()}))
    with pytest.raises(DataError, match="applied has shape"):
        load_compensator(file)


@pytest.fixture
def law_file(tmp_path):
    file = tmp_path / "gimbal.json"
    write_compensator(file, random_law(np.random.default_rng(1), 6, 2, 1))
    return file


def test_the_verb_writes_all_forms(law_file, tmp_path, capfd):
    out = [tmp_path / f"out.{ending}" for ending in ("mdk", "json", "c")]
    written = [word for file in out for word in ("-o", file)]
    done = middeck(capfd, "generate", law_file, "--range", "0.1,2", "--limit", "0.25", "--json", *written)
    assert done.code == 0, done.err
    document = json.loads(done.out)
    assert {f.name for f in tmp_path.iterdir()} == {"gimbal.json", "out.mdk", "out.json", "out.c", "out.h"}
    assert load_package(out[0]) == load_package(out[1])
    assert document["sha256"] == hash_package(load_package(out[0]))
    assert document["sha256"] in out[2].with_suffix(".h").read_text()
    again = middeck(capfd, "generate", out[0], "--single", "-o", tmp_path / "small.mdk")
    assert again.code == 0
    assert "single" in again.out
    assert load_package(tmp_path / "small.mdk").single


def test_single_precision_of_several_outputs_is_shown(tmp_path, capfd):
    file = tmp_path / "two.json"
    write_compensator(file, random_law(np.random.default_rng(4), 6, 1, 2))
    done = middeck(capfd, "generate", file, "--range", "0.1", "--limit", "0.25,0.5", "--single")
    assert done.code == 0, done.err
    package = to_single(package_law(load_compensator(file), "two", input_range=0.1, limit=(0.25, 0.5)))
    shown = [
        float(line.split()[-1])
        for line in done.out.splitlines()
        if line.startswith(package.outputs[0].name[:1])
    ]
    assert [float(f"{bound:g}") for bound in package.error_bound] == shown[-2:]
    assert "overflow     in no operation, and no NaN: inputs are cut to their ranges\n" in done.out


@pytest.mark.parametrize(
    ("arguments", "code", "says"),
    [
        (["-o", "law.txt"], 2, "a file that ends in .mdk, .json, .c, .h"),
        (["--rate", "100"], 2, "the law is sampled at 500 Hz"),
        (["--limit", "1,2,3"], 2, "3 limits for 1 ports"),
        (["--single"], 2, "has no range"),
        (["--name", "a b"], 2, "the name 'a b'"),
        (["--name", ""], 2, "the name ''"),
        (["--rule", "hold"], 2, "--rule is for a continuous law"),
        (["--single", "--form", "dense"], 2, "--single with --form dense"),
        (["-o", "new.mdk", "-o", "2law.c"], 2, "the C name '2law'"),
        (["-o", "gimbal.json"], 2, "would be written over"),
    ],
)
def test_the_verb_refuses(law_file, arguments, code, says, capfd, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    done = middeck(capfd, "generate", law_file, *arguments)
    assert done.code == code
    assert says in done.err
    assert [file.name for file in tmp_path.iterdir()] == [
        "gimbal.json"
    ]  # nothing is written before all is checked


def test_the_header_of_a_source_is_not_written_over_the_law(law_file, tmp_path, capfd):
    law = law_file.rename(tmp_path / "law.h")
    before = law.read_bytes()
    done = middeck(capfd, "generate", law, "-o", tmp_path / "law.c")
    assert (done.code, law.read_bytes()) == (2, before)
    assert "would be written over" in done.err
    assert not (tmp_path / "law.c").exists()


def test_a_header_can_be_written_alone(law_file, tmp_path, capfd):
    """For who has the source of this very package: it is the header that a source brings along."""
    asked = ["generate", law_file, "--range", "0.1,2", "--limit", "0.25"]
    assert middeck(capfd, *asked, "-o", tmp_path / "law.c").code == 0
    whole = (tmp_path / "law.h").read_bytes()
    for file in tmp_path.glob("law.*"):
        file.unlink()
    done = middeck(capfd, *asked, "-o", tmp_path / "law.h", "--json")
    assert done.code == 0
    assert json.loads(done.out)["files"] == [str(tmp_path / "law.h")]
    assert {file.name for file in tmp_path.iterdir()} == {"gimbal.json", "law.h"}
    assert (tmp_path / "law.h").read_bytes() == whole


def test_other_files_are_named_for_what_they_are(law_file, tmp_path, capfd):
    package = tmp_path / "law.mdk"
    write_package(package, whole())
    assert "a controller package" in middeck(capfd, "record", package).err
    for again in (
        ["--limit", "1"],
        ["--rule", "hold"],
        ["--form", "dense"],
        ["--name", "b"],
        ["--ramp", "0"],
    ):
        assert "cannot be given again" in middeck(capfd, "generate", package, *again).err
    assert middeck(capfd, "generate", tmp_path / "none.mdk").code == 4
    with pytest.raises(MiddeckError, match=r"begins otherwise|schema"):
        load_package(law_file)
