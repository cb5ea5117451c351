"""Random sampled laws, and the generated C of packages as a function of this process."""

from __future__ import annotations

import ctypes
import subprocess
from collections.abc import Callable
from pathlib import Path

import numpy as np

from middeck.control.law.compensator import Compensator
from middeck.realtime.generate.c_source import generate_c
from middeck.realtime.package.package import ControllerPackage
from middeck.signals.ports import Port
from middeck.systems.state_space.statespace import SampledStateSpace

STRICT = ("-std=c99", "-Wall", "-Wextra", "-Werror", "-pedantic", "-ffp-contract=off")
PERIOD_S = 0.002
ALIGNED = 64
"""As a compiler lays a state that is static."""
RUN = """
int run(law_state *s, const law_real *y, law_real *u, int count);
unsigned long size(void);
int run(law_state *s, const law_real *y, law_real *u, int count)
{
    int k, taken = 0;

    for (k = 0; k < count; ++k)
        taken += law_step(s, y + k * LAW_INPUTS, u + k * LAW_OUTPUTS);
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


def compile_law(package: ControllerPackage, folder: Path, *flags: str) -> Callable[[np.ndarray], np.ndarray]:
    """The law of ``package`` in C, from a reset: samples of y to samples of u."""
    prepare = steps_in_c(package, folder, *flags)
    return lambda y: prepare(y)().astype(float)


def steps_in_c(
    package: ControllerPackage, folder: Path, *flags: str
) -> Callable[[np.ndarray], Callable[[], np.ndarray]]:
    """For samples of y, a call that takes the steps from a reset, and does nothing else."""
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

    def prepare(y: np.ndarray) -> Callable[[], np.ndarray]:
        room = ctypes.create_string_buffer(loaded.size() + ALIGNED)
        state = (ctypes.c_char * loaded.size()).from_buffer(room, -ctypes.addressof(room) % ALIGNED)
        given, u = np.ascontiguousarray(y, dtype=real), np.zeros((len(y), len(package.outputs)), real)
        places = ctypes.c_void_p(given.ctypes.data), ctypes.c_void_p(u.ctypes.data)

        def run() -> np.ndarray:
            assert len(given) == len(u)
            loaded.law_reset(state)
            loaded.run(state, *places, len(u))
            return u

        return run

    return prepare


def replay(package: ControllerPackage, folder: Path, *flags: str) -> int:
    """Exit code of the program that replays the test vectors, compiled with ``flags``."""
    made = generate_c(package, "law")
    (folder / "law.h").write_text(made.header)
    (folder / "law.c").write_text(made.source)
    subprocess.run(["cc", *STRICT, *flags, "-DLAW_MAIN", "law.c", "-o", "replay"], cwd=folder, check=True)
    return subprocess.run(["./replay"], cwd=folder, check=False).returncode
