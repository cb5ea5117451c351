"""The engine runs a package with the bits of its reference, in the order of its states."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import numpy as np
import pytest

from engine_cases import OUTPUTS, plain_settings, random_article, random_package
from middeck.realtime.engine.interface.header import constants, layout
from middeck.realtime.engine.process.compile import build_engine, engine_sources
from middeck.realtime.generate import compiler as cache
from middeck.realtime.package.reference import ReferenceLaw
from packaged_laws import CLEAN
from ungated import Supervisor

pytestmark = pytest.mark.usefixtures("compiler")
RECORDS = (
    "section", "hold_path", "monitor", "spread", "adaptive", "settings", "article", "command",
    "acknowledgement", "event", "record_head", "asks", "status", "places",
)  # fmt: skip


OUTSIDE = {"main.c", "mapped.c", "loader.c", "lockstep.c", "real_time.c"}
"""Start and end, the thread beside the loop, and what waits for the next sample."""


def test_both_sides_lay_out_the_shared_file_alike(tmp_path):
    """Sizes, places and enumerated values as the compiler has them."""
    wanted, lines = [], []
    for record in RECORDS:
        kind = layout(record)
        wanted += [kind.itemsize, *(kind.fields[name][1] for name in kind.names)]
        lines.append(f'printf("%zu\\n", sizeof({record}));')
        lines += [f'printf("%zu\\n", offsetof({record}, {name}));' for name in kind.names]
    for name, value in constants().items():
        wanted.append(value)
        lines.append(f'printf("%d\\n", {name});')
    body = "\n".join(lines)
    (tmp_path / "shared.h").write_text(engine_sources()["shared.h"])
    main = f"int main(void) {{ {body} return 0; }}\n"
    (tmp_path / "a.c").write_text(f'#include <stddef.h>\n#include <stdio.h>\n#include "shared.h"\n{main}')
    subprocess.run(["cc", "a.c", "-o", "a"], cwd=tmp_path, check=True)
    found = subprocess.run(["./a"], cwd=tmp_path, capture_output=True, text=True, check=True).stdout
    assert [int(line) for line in found.split()] == wanted


@pytest.mark.parametrize(
    ("form", "real_time", "samples"), [("modal", False, 3000), ("dense", False, 3000), ("modal", True, 600)]
)
def test_the_loop_has_the_bits_of_the_reference(form, real_time, samples):
    """Fading in, within its limits and at them, with the torque really applied in its estimate."""
    package = random_package(form=form)
    with Supervisor(plain_settings(late_s=1e3), random_article(), real_time=real_time) as engine:
        assert engine.load(package).done
        assert engine.reset().done
        assert engine.command("engage", values=[1.0]).done
        records = engine.run(samples)
    records = records[records["slots"] != 0]  # a clock does not wait for the engagement
    reference = ReferenceLaw(package)
    expected = np.array([reference.step(row) for row in records["y"]])
    assert np.array_equal(records["u"].view(np.int64), expected.view(np.int64))
    assert np.any(np.abs(expected) == 0.5)
    assert np.any(np.abs(expected) < 0.5)


def recorded(*pieces: int, program: Path | None = None) -> bytes:
    """The records of a run in so many pieces."""
    with Supervisor(plain_settings(), random_article(), program=program) as engine:
        engine.load(random_package())
        engine.reset()
        engine.command("engage", values=[1.0])
        return np.concatenate([engine.run(piece) for piece in pieces]).tobytes()


def test_the_same_seed_gives_the_same_bytes():
    """However the run is cut into pieces."""
    assert recorded(900) == recorded(1, 449, 450)


def test_a_second_compiler_gives_the_same_bytes(clang, monkeypatch):
    """And neither warns of anything: where one does no program is kept."""
    runs = []
    for compiler in ("cc", clang):
        monkeypatch.setenv("CC", compiler)
        runs.append(recorded(900, program=build_engine(flags=CLEAN)))
    assert runs[0] == runs[1]


def test_the_engine_calls_no_allocator(tmp_path):
    """Nor anything else that waits, but `OUTSIDE` and in the rigs."""
    sources = engine_sources()
    for name, text in sources.items():
        (tmp_path / name).write_text(text)
    everything = [name for name in sources if name.endswith(".c")]
    loop = [name for name in everything if name not in OUTSIDE and not name.startswith("rig_")]
    build = ["cc", "-std=c99", "-O0", "-ffp-contract=off", "-c"]
    subprocess.run([*build, *everything], cwd=tmp_path, check=True)

    def needed(files):
        objects = [name.replace(".c", ".o") for name in files]
        listed = subprocess.run(["nm", *objects], cwd=tmp_path, capture_output=True, text=True, check=True)
        known = set(re.findall(r"^[0-9a-f]+ [A-Z] (\w+)", listed.stdout, re.MULTILINE))
        return set(re.findall(r"^ +U (\w+)", listed.stdout, re.MULTILINE)) - known

    asked_of_any_target = {"_GLOBAL_OFFSET_TABLE_", "__stack_chk_fail"}
    assert (
        needed(loop)
        <= {"memcpy", "memset", "memmove", "memcmp", "sqrt", "ceil", "fabs", "hypot", "log", "log1p"}
        | {"clock_gettime", "load_package"}  # the clock; in lockstep, where time waits for a package
        | asked_of_any_target
    )
    assert not {name for name in needed(everything) if re.search("alloc|free$", name)}


def test_nothing_moves_before_a_reset():
    with Supervisor(plain_settings(), random_article()) as engine:
        assert engine.state == "safe"
        assert engine.load(random_package()).done
        assert engine.command("engage", values=[1.0]).word == "not ready"
        assert np.all(engine.run(50)["u"] == np.zeros(OUTPUTS))
        assert engine.command("reset", values=[3.0]).word == "wrong trip"
        assert engine.reset().done
        assert engine.state == "ready"


@pytest.mark.usefixtures("compiler")
def test_the_program_is_compiled_once_into_the_user_s_cache(tmp_path, monkeypatch):
    """And anew for other sources or flags alone, beside the one that is there."""
    made = []

    def seen(_, sources, flags, target):
        made.append(flags)
        target.parent.mkdir(parents=True, exist_ok=True)
        target.write_bytes(b"program")

    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    monkeypatch.setattr(cache, "_compile", seen)
    first = build_engine()
    assert first.parent == tmp_path / "middeck"
    assert build_engine() == first
    assert made == [()]
    driver = tmp_path / "rig_driver.c"
    driver.write_text("int other;\n")
    others = {build_engine(flags=("-O0",)), build_engine(driver=driver)}
    assert made == [(), ("-O0",), ()]
    assert len(others | {first}) == 3
    assert all(path.read_bytes() == b"program" for path in others | {first})
