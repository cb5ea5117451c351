"""The C of a package gives the bits of the reference: by every build path, and on small processors."""

from __future__ import annotations

import dataclasses
import re
import subprocess
from pathlib import Path

import numpy as np
import pytest
from small_processor.emulated import emulate_package

from middeck.errors import ConfigError
from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.filter_sections import InputFilter, LoopPath, Section
from middeck.realtime.package.package_law import package_law
from middeck.realtime.package.reference import ReferenceLaw
from middeck.realtime.package.single_precision import to_single
from middeck.realtime.package.vectors import add_test_vectors
from middeck.signals.ports import Port
from packaged_laws import CLEAN, STRICT, compile_law, random_law, replay, steps_in_c
from repeats import LONG, repeats
from study_compensators import study_law

pytestmark = pytest.mark.usefixtures("compiler")
SECTION = Section(np.array([0.2, 0.3, 0.1]), np.array([-0.5, 0.2]))
SANITIZERS = ("-O1", "-g", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
BUILDS = [("-O0",), ("-O2",), ("-O3", "-march=native"), ("-Os",), SANITIZERS]
CPU = Path("/proc/cpuinfo")
if CPU.exists() and {"avx2", "avx512f"} <= set(CPU.read_text().split()):
    BUILDS.append(("-O3", "-mavx2"))  # registers of half the width of native ones
# states, inputs, outputs, form, applied, ramp
SHAPES = [
    (60, 14, 5, "modal", True, 0.01),
    (20, 3, 2, "dense", True, 0.0),
    (7, 2, 1, "auto", False, 0.01),
    (1, 1, 2, "dense", True, 0.0),
    (0, 2, 1, "auto", False, 0.0),
    (5, 1, 1, "modal", True, 0.0),
]


def package_of(seed, states, inputs, outputs, form, applied, ramp_s, **more):
    law = random_law(np.random.default_rng(seed), states, inputs, outputs, applied=applied)
    return package_law(
        law, "law", input_range=0.1, limit=0.5, slew_rate=40.0, ramp_s=ramp_s, form=form, **more
    )


def with_sections(package):
    paths = (
        LoopPath(0, 0, SECTION),
        LoopPath(len(package.inputs) - 1, 0, Section([-1.0, 0.5, 0.0], [0.0, 0.0])),
    )
    return add_test_vectors(dataclasses.replace(package, paths=paths))


@pytest.mark.parametrize("flags", BUILDS, ids=lambda flags: flags[-1].lstrip("-")[:12])
@pytest.mark.parametrize("shape", SHAPES if LONG else SHAPES[:5:2], ids=str)
def test_every_build_gives_the_bits_of_the_reference(shape, flags, tmp_path):
    package = package_of(1, *shape, filters=(InputFilter(0, SECTION), InputFilter(0, SECTION)))
    assert replay(with_sections(package), tmp_path, *flags) == 0


def test_options_of_every_day_give_the_bits_of_the_reference(clang, tmp_path):
    """Without those that the page asks for a product is fused with a sum where the processor can do so.

    In the dialect of the standard gcc fuses none and is told nothing, unless it is asked to fuse.
    """
    package = with_sections(package_of(1, *SHAPES[1], filters=(InputFilter(0, SECTION),)))
    made = generate_c(package, "law")
    (tmp_path / "law.h").write_text(made.header)
    (tmp_path / "law.c").write_text(made.source)
    for compiler in (["cc"], ["cc", "-std=c99"], ["cc", "-std=c99", "-ffp-contract=fast"], [clang]):
        build = [*compiler, *CLEAN, "-O2", "-march=native", "-DLAW_MAIN", "law.c", "-o", "replay"]
        subprocess.run(build, cwd=tmp_path, check=True)
        assert subprocess.run(["./replay"], cwd=tmp_path, check=False).returncode == 0


def test_a_reset_leaves_nothing_of_what_was(tmp_path):
    """Of ramp, slew, sections and estimate: a state that was used gives, after it, the bits of a new one."""
    package = with_sections(package_of(4, *SHAPES[2], filters=(InputFilter(0, SECTION),)))
    prepare, rng = steps_in_c(package, tmp_path), np.random.default_rng(4)
    run = prepare(rng.uniform(-0.1, 0.1, (50, 2)))
    first, after = run().copy(), run().copy()
    assert np.ptp(first) > 0.1
    assert np.array_equal(after, first)


@pytest.mark.parametrize("single", [False, True])
def test_thousands_of_samples_agree_to_the_bit(single, tmp_path):
    rng = np.random.default_rng(5)
    law = random_law(rng, 12, 3, 2, radii=(0.9, 0.99))
    package = package_law(law, "law", input_range=0.3, limit=2.0, ramp_s=0.1)
    package = to_single(package) if single else package
    y = np.vstack([rng.uniform(-0.4, 0.4, (1200, 3)), np.full((1, 3), np.nan), np.full((1, 3), -np.inf),
                   rng.uniform(-0.1, 0.1, (800, 3))])  # fmt: skip
    reference = ReferenceLaw(package)
    expected = np.array([reference.step(row) for row in y])
    for build in ((), ("-O3", "-march=native")):
        found = compile_law(package, tmp_path, *build)(y)
        assert np.array_equal(found, expected.astype(float))
    assert np.abs(found).max() <= 2.0
    assert np.any(np.abs(found) == 2.0)  # the limits did act


@pytest.mark.parametrize("shape", SHAPES if LONG else SHAPES[:5:2], ids=str)
def test_a_second_compiler_gives_the_same_bits(shape, clang, tmp_path):
    package = package_of(1, *shape)
    assert replay(package, tmp_path, "-O3", "-march=native", "-Wshadow", compiler=clang) == 0


def test_the_header_serves_cplusplus(clang, tmp_path):
    made = generate_c(package_of(2, *SHAPES[3]), "law")
    (tmp_path / "law.h").write_text(made.header)
    (tmp_path / "law.c").write_text(made.source)
    (tmp_path / "user.cpp").write_text('#include "law.h"\nint main() { return law_replay(); }\n')
    subprocess.run([clang, *STRICT, "-DLAW_REPLAY", "-c", "law.c"], cwd=tmp_path, check=True)
    user = [clang, "-x", "c++", "-std=c++11", *CLEAN, "user.cpp", "-x", "none", "law.o", "-o", "user"]
    subprocess.run(user, cwd=tmp_path, check=True)
    assert subprocess.run(["./user"], cwd=tmp_path, check=False).returncode == 0


def test_a_changed_coefficient_fails_the_replay(tmp_path):
    package = package_of(2, *SHAPES[3])
    core = dataclasses.replace(package.core, D=np.nextafter(package.core.D, 9.0))
    wrong = dataclasses.replace(package, core=core)
    assert replay(package, tmp_path, "-O2") == 0
    assert replay(wrong, tmp_path, "-O2") == 1


@pytest.mark.parametrize(
    "flag", ["-ffast-math", "-Ofast", "-ffinite-math-only", "-fno-signed-zeros", "-freciprocal-math"]
)
def test_no_part_of_fast_math_compiles(flag, tmp_path):
    made = generate_c(package_of(2, *SHAPES[3]), "law")
    (tmp_path / "law.h").write_text(made.header)
    (tmp_path / "law.c").write_text(made.source)
    failed = subprocess.run(
        ["cc", "-std=c99", flag, "-c", "law.c"], cwd=tmp_path, capture_output=True, check=False
    )
    assert failed.returncode != 0
    assert b"compile without -f" in failed.stderr


def test_a_processor_that_keeps_more_digits_between_operations_is_refused(tmp_path):
    """As the x87 does; here its compiler is played by what it says of itself."""
    made = generate_c(package_of(2, *SHAPES[3]), "law")
    (tmp_path / "law.h").write_text(made.header)
    (tmp_path / "law.c").write_text(made.source)
    for method, passes in ((2, False), (1, False), (0, True)):
        build = ["cc", "-std=c99", "-U__FLT_EVAL_METHOD__", f"-D__FLT_EVAL_METHOD__={method}", "-c", "law.c"]
        done = subprocess.run(build, cwd=tmp_path, capture_output=True, check=False)
        assert (done.returncode == 0) == passes
        assert (b"rounds each operation to its type" in done.stderr) != passes


def test_the_object_calls_nothing(tmp_path):
    """No library, no allocation, no global that changes."""
    made = generate_c(package_of(2, *SHAPES[0]), "law")
    (tmp_path / "law.h").write_text(made.header)
    (tmp_path / "law.c").write_text(made.source)
    build = ["cc", *STRICT, "-O2", "-ffreestanding", "-fno-builtin", "-c", "law.c"]
    subprocess.run(build, cwd=tmp_path, check=True)
    symbols = subprocess.run(["nm", "law.o"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    needed = set(re.findall(r"^ +U (\w+)", symbols, re.MULTILINE))
    assert needed <= {"memcpy", "memset", "_GLOBAL_OFFSET_TABLE_"}  # which any compiler may ask of its target
    assert not re.search(r" [BbDdCc] ", symbols)


def test_names_of_ports_cannot_leave_their_comment(tmp_path):
    law = random_law(np.random.default_rng(0), 2, 1, 1)
    evil = Port('*/ int main(void){return 7;} /* ??/ "\\ \u202e'.replace("\u202e", "é"), "N*/m")
    package = package_law(dataclasses.replace(law, inputs=(evil,)), "law")
    assert replay(package, tmp_path, "-O1") == 0


def test_a_name_that_c_does_not_allow_is_refused():
    with pytest.raises(ConfigError, match="C name"):
        generate_c(package_of(2, *SHAPES[3]), "2law")


@pytest.mark.parametrize("flags", [("-std=c99", "-ffp-contract=off"), ()], ids=["asked for", "none"])
@pytest.mark.parametrize("single", [False, True], ids=["double on a Cortex-M7", "single on a Cortex-M4"])
def test_a_small_processor_gives_the_same_bits(single, flags, tmp_path, small_processors):
    law = random_law(np.random.default_rng(3), 12, 3, 2, radii=(0.9, 0.99))
    paths = (LoopPath(1, 0, SECTION),)
    package = package_law(
        law, "law", input_range=0.1, limit=0.5, ramp_s=0.01, filters=(InputFilter(0, SECTION),)
    )
    package = add_test_vectors(dataclasses.replace(package, paths=paths))
    found = emulate_package(to_single(package) if single else package, tmp_path, flags)
    assert found.first_difference == 0
    assert 300 < found.instructions < 3000
    assert found.flash < 8192
    assert found.memory < 1024


@pytest.mark.parametrize("single", repeats([False, True]))
def test_a_small_processor_gives_the_bits_of_a_law_of_the_study(single, tmp_path, small_processors):
    """46 states, 14 in, 5 out, which learns what is applied; ten instructions for each of 1036 products."""
    package = package_law(study_law(0.0), "law", input_range=0.02, limit=5.0)
    found = emulate_package(to_single(package) if single else package, tmp_path)
    assert found.first_difference == 0
    assert 4000 < found.instructions < 10 * 1036
    assert found.flash < 16_384
    assert found.memory < 1280
