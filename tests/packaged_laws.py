"""Random sampled laws, and the generated C of packages as a function of this process."""

from __future__ import annotations

import ctypes
import dataclasses
import subprocess
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.package import ControllerPackage
from middeck.realtime.package.package_law import without_applied
from middeck.realtime.package.rounding_errors import LinearLaw, unfold_law
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace

CLEAN = ("-Wall", "-Wextra", "-Werror", "-pedantic")
STRICT = ("-std=c99", *CLEAN, "-ffp-contract=off")
PERIOD_S = 0.002
ALIGNED = 64
"""As a compiler lays a state that is static."""
BLOCK = 200
"""Samples of a response at a time."""
RUN = """
int run(law_state *s, const law_real *y, law_real *u, int count);
int run_applied(law_state *s, const law_real *y, law_real *u, const law_real *applied, int count);
unsigned long size(void);
int run(law_state *s, const law_real *y, law_real *u, int count)
{
    int k, taken = 0;

    for (k = 0; k < count; ++k)
        taken += law_step(s, y + k * LAW_INPUTS, u + k * LAW_OUTPUTS);
    return taken;
}
int run_applied(law_state *s, const law_real *y, law_real *u, const law_real *applied, int count)
{
    int k, taken = 0;

    for (k = 0; k < count; ++k) {
        taken += law_compute(s, y + k * LAW_INPUTS, u + k * LAW_OUTPUTS);
        law_commit(s, applied + k * LAW_OUTPUTS);
    }
    return taken;
}
unsigned long size(void)
{
    return sizeof(law_state);
}
"""


def ports(states: int, inputs: int, outputs: int) -> tuple[tuple[Port, ...], tuple[Port, ...]]:
    return (
        tuple(Port(f"y{i}", "rad") for i in range(inputs)),
        tuple(Port(f"u{i}", "N m") for i in range(outputs)),
    )


def random_law(
    rng: np.random.Generator,
    states: int,
    inputs: int,
    outputs: int,
    *,
    applied: bool = True,
    radii: tuple[float, float] = (0.9, 0.999),
) -> Compensator:
    """Poles of magnitudes within ``radii`` in coordinates of any direction; a path if ``applied``."""
    A = np.zeros((states, states))
    for i in range(0, states - 1, 2):
        angle, r = rng.uniform(0.02, 2.8), rng.uniform(*radii)
        c, s = r * np.cos(angle), r * np.sin(angle)
        A[i : i + 2, i : i + 2] = [[c, s], [-s, c]]
    if states % 2:
        A[-1, -1] = rng.uniform(-0.9, 0.9)
    T = np.linalg.qr(rng.standard_normal((states, states)))[0]
    B, C = rng.standard_normal((states, inputs)), rng.standard_normal((outputs, states))
    system = SampledStateSpace(T @ A @ T.T, B, C, rng.standard_normal((outputs, inputs)), period_s=PERIOD_S)
    E = 2e-3 * rng.standard_normal((states, outputs)) if applied else None
    return Compensator(system, *ports(states, inputs, outputs), applied=E)


def compile_law(package: ControllerPackage, folder: Path, *flags: str) -> Callable[..., np.ndarray]:
    """The law of ``package`` in C, from a reset: samples of y (and of what is applied) to samples of u."""
    prepare = steps_in_c(package, folder, *flags)
    return lambda *y: prepare(*y)().astype(float)


def steps_in_c(
    package: ControllerPackage, folder: Path, *flags: str
) -> Callable[..., Callable[[], np.ndarray]]:
    """For samples of y, a call that takes the steps from a reset, and does nothing else.

    With samples of commands, these are applied; else the law's own are.
    """
    made = generate_c(package, "law")
    (folder / "law.h").write_text(made.header)
    (folder / "law.c").write_text(made.source + RUN)
    library = folder / f"law{len(list(folder.iterdir()))}.so"
    subprocess.run(
        ["cc", *STRICT, "-O2", *flags, "-shared", "-fPIC", "law.c", "-o", library.name],
        cwd=folder,
        check=True,
    )
    loaded = ctypes.CDLL(str(library))
    loaded.size.restype = ctypes.c_ulong
    real = np.float32 if package.single else np.float64

    def prepare(y: np.ndarray, *applied: np.ndarray) -> Callable[[], np.ndarray]:
        room = ctypes.create_string_buffer(loaded.size() + ALIGNED)
        state = (ctypes.c_char * loaded.size()).from_buffer(room, -ctypes.addressof(room) % ALIGNED)
        given, u = np.ascontiguousarray(y, dtype=real), np.zeros((len(y), len(package.outputs)), real)
        rows = given, u, *(np.ascontiguousarray(one, dtype=real) for one in applied)
        places = [ctypes.c_void_p(one.ctypes.data) for one in rows]
        steps = loaded.run_applied if applied else loaded.run

        def run() -> np.ndarray:
            assert all(len(one) == len(u) for one in rows)
            loaded.law_reset(state)
            steps(state, *places, len(u))
            return u

        return run

    return prepare


def replay(package: ControllerPackage, folder: Path, *flags: str, compiler: str = "cc") -> int:
    """Exit code of the program that replays the test vectors, compiled with ``flags``."""
    made = generate_c(package, "law")
    (folder / "law.h").write_text(made.header)
    (folder / "law.c").write_text(made.source)
    subprocess.run([compiler, *STRICT, *flags, "-DLAW_MAIN", "law.c", "-o", "replay"], cwd=folder, check=True)
    return subprocess.run(["./replay"], cwd=folder, check=False).returncode


def worst_error(
    package: ControllerPackage, single: ControllerPackage, count: int, folder: Path
) -> np.ndarray:
    """Largest difference of outputs in C, ``single`` to ``package``, which ``count`` samples find.

    Inputs are those of `worst_signs` in full and at three tenths, and noise. What is applied is the law's own
    command, or one within its limits, unless the bound is for its own commands.
    """
    runs, m = [compile_law(one, folder) for one in (package, single)], len(package.inputs)
    own = single.error_bound_own
    noise = np.sign(np.random.default_rng(5).standard_normal((count, m + len(package.outputs))))
    worst = np.zeros(len(package.outputs))
    moved = without_applied(package) if own else package
    for signs in (*worst_signs(moved, count), noise):
        for part in (1.0, 0.3):
            y = (part * single.input_range * signs[:, :m]).astype(np.float32).astype(float)
            tried = [(y,)]
            if package.core.drives and not own:
                limit = np.where(signs[:, m:] > 0.0, single.upper, single.lower)
                tried.append((y, np.where(signs[:, m:] == 0.0, 0.0, part * limit).astype(np.float32)))
            for given in tried:
                exact, rounded = (run(*given) for run in runs)
                worst = np.maximum(worst, np.abs(exact - rounded).max(axis=0))
    return worst


def worst_signs(package: ControllerPackage, count: int) -> Iterator[np.ndarray]:
    """For each output, signs of y and of commands applied of which rounded coefficients err most.

    At the last sample: they are the signs of the response of what is cut, backwards (Desoer and Vidyasagar
    1975, section 4.8). Between the limits.
    """
    exact, rounded = (_estimating(unfold_law(package, single=single)) for single in (False, True))
    n = len(exact.F)
    F = np.block([[exact.F, np.zeros((n, n))], [rounded.F - exact.F, rounded.F]])
    G = np.vstack([exact.G, rounded.G - exact.G])
    outputs = list(exact.wanted)
    for h, direct in zip(
        np.hstack([rounded.H - exact.H, rounded.H])[outputs], (rounded.J - exact.J)[outputs], strict=True
    ):
        signs = np.sign(np.vstack([direct, *_response(F, G, h, count - 1)])[:count])
        yield signs[::-1]


def _estimating(law: LinearLaw) -> LinearLaw:
    """``law`` of y and of what is applied, a = w + e, without the errors of its sums."""
    p, w = len(law.wanted), list(law.wanted)
    m = law.first - len(law.F) - p
    y, e = slice(0, m), slice(m, m + p)
    by_e = law.G[:, e]
    G = np.hstack([law.G[:, y] - by_e @ law.J[w, y], by_e])
    return dataclasses.replace(law, F=law.F - by_e @ law.H[w], G=G, J=law.J[:, : m + p])


def _response(F: np.ndarray, G: np.ndarray, h: np.ndarray, count: int) -> Iterator[np.ndarray]:
    """h F^k G in blocks."""
    rows = np.empty((BLOCK, len(F)))
    for k in range(BLOCK):
        rows[k], h = h, h @ F
    leap = np.linalg.matrix_power(F, BLOCK)
    for _ in range(0, count, BLOCK):
        yield rows @ G
        G = leap @ G
