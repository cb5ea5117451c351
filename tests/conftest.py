"""One thread for BLAS, seeded campaigns, and skips that CI does not allow."""

import gc
import os
import shutil
from pathlib import Path
from typing import NoReturn

# Before numpy is imported: small matrices gain nothing from threads, and bytes depend on their number.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from coarse_articles import coarse  # noqa: E402
from long_results import LongResults  # noqa: E402
from middeck.files.setups import load_environment, load_structure  # noqa: E402
from middeck.files.studies.documents import load_study  # noqa: E402
from middeck.structure.rest.equilibrium import solve_equilibrium  # noqa: E402
from repeats import LONG  # noqa: E402
from shared_results import once  # noqa: E402

# Tests make many values and few cycles; what was imported has none to be looked for.
gc.freeze()
gc.set_threshold(50_000, 20, 20)

ROOT = Path(__file__).parents[1]
SEED = 1993
at_rest_lately = once(solve_equilibrium, kept=200)
SHARE = 20  # `make test` runs a twentieth of each campaign

# Independent programs with environments of their own; nothing here imports them.
collect_ignore = ["cross/sheet_by_autodiff", "cross/suspended_bus", "cross/survey", "cross/uff"]
collect_ignore_glob = ["cross/*/make_*.py"]

settings.register_profile("ours", max_examples=20 * SHARE if LONG else 20, derandomize=True, deadline=None)
settings.load_profile("ours")


@pytest.fixture(scope="session")
def campaign():
    """``campaign(whole)``: seeds of ``whole`` runs, of which the first twentieth unless all are asked for.

    ``campaign(whole, share)`` leaves the first ``share``-th instead.
    """

    def seeds(whole: int, share: int = SHARE) -> range:
        return range(SEED, SEED + (whole if LONG else max(1, whole // share)))

    return seeds


# They take the paper's study, and stay on one worker so that it runs once.
PAPER = {
    *("tests/edges/test_numbers.py", "tests/edges/test_report.py"),
    *("tests/paper/test_experiments_on_engine.py", "tests/paper/test_promise_kept.py"),
    *("tests/paper/test_study_claims.py", "tests/paper/test_pictures_of_the_study.py"),
}
# Examples of verbs that fit, refine and promise alike, once (`cli_runner.share_results`).
EXAMPLES = {"tests/docs/test_examples.py", "tests/edges/test_cli_hygiene.py"}
# They fit the same simulated gimbals, once (`gimbal_fits`, `two_modes`).
GIMBAL = {f"tests/truth/test_{n}.py" for n in ("drift", "model_set", "uncertainty", "uncertainty_campaign")}
# They promise on the same refinement (`promise_case.refined`).
PROMISE = {f"tests/truth/test_{n}.py" for n in ("promise", "promise_friction")}


@pytest.hookimpl(optionalhook=True)
def pytest_xdist_make_scheduler(config, log):
    """Files stay whole on a worker, and what their fixtures of a module share is computed once."""
    from xdist.scheduler import LoadScopeScheduling

    class ByFile(LoadScopeScheduling):
        def _split_scope(self, nodeid):
            file = nodeid.partition("::")[0]
            return next((min(group) for group in (PAPER, EXAMPLES, GIMBAL, PROMISE) if file in group), file)

    return ByFile(config, log)


def pytest_collection_modifyitems(items):
    """Refuse another file that would run the paper's study once more."""
    takers = {
        i.nodeid.partition("::")[0] for i in items if "paper_outcomes" in getattr(i, "fixturenames", ())
    }
    if takers - PAPER:
        raise pytest.UsageError(f"add {', '.join(takers - PAPER)} to PAPER in tests/conftest.py")


@pytest.fixture(scope="session", autouse=True)
def shared_rest_states():
    """Refinements, verbs and studies of many tests begin at the same rest states: solved once a worker."""
    rooms = ("updating.residuals.surveys", "updating.residuals.static_tests", "cli.given.typed_article")
    with pytest.MonkeyPatch.context() as patch:
        for room in (*rooms, "study.shared", "laboratory.tested_article"):
            patch.setattr(f"middeck.{room}.solve_equilibrium", at_rest_lately)
        yield


@pytest.fixture(scope="session")
def dm():
    """The development model, on a coarse mesh."""
    return load_structure(coarse("mace-dm"))


@pytest.fixture(scope="session")
def lab():
    """The laboratory it hangs in."""
    return load_environment(ROOT / "environments/lab.toml")


@pytest.fixture(scope="session")
def paper_study():
    """The study of the paper as it is shipped."""
    return load_study(ROOT / "studies/mace-1993.toml")


@pytest.fixture(scope="session")
def paper_outcomes(paper_study):
    """Its chapters but the mirror, which has its own tests and takes long; once a session.

    `make test` promises fewer compensators by fewer draws, on a coarse mesh. Its tests keep their length:
    of periods of 12 s, a fit by OpenBLAS's kernel for AVX-512 gave loops whose stability is undecided.
    """
    from middeck.study.mission import run_chapters  # with matplotlib, which few tests need

    fewer = ("promise.draws=4", "promise.log10_authority=[0, 3]", "mesh.elements_per_strut=2")
    quick = load_study(ROOT / "studies/mace-1993.toml", () if LONG else fewer)
    chapters = {**dict(run_chapters(paper_study)), "promise": dict(run_chapters(quick))["promise"]}
    return {name: run() for name, run in chapters.items() if name != "mirror"}


@pytest.fixture(scope="session")
def chromium():
    """Path of a real browser; without one the test is skipped, which CI turns into a failure."""
    return _program("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def compiler():
    """The C compiler of this machine."""
    return _program("cc", "gcc", "clang")


@pytest.fixture(scope="session")
def sanitized_engine(compiler):
    """The engine with address and undefined-behaviour sanitizers, compiled once while its sources stay."""
    from fuzzed_packages import SANITIZED  # which few tests need
    from middeck.errors import ConfigError
    from middeck.realtime.engine.process.compile import build_engine
    from middeck.realtime.generate.compiler import compile_once

    flags = (*SANITIZED, "-O1")
    try:
        compile_once("nothing", {"nothing.c": "int main(void) { return 0; }\n"}, flags=flags)
    except ConfigError:
        _missing("sanitizers of the C compiler")
    return build_engine(flags=flags)


@pytest.fixture(scope="session")
def clang():
    """Path of a second compiler, of C and C++."""
    return _program("clang")


@pytest.fixture(scope="session")
def small_processors():
    """A cross compiler and an emulator: gcc-arm-none-eabi and qemu-system-arm of Debian."""
    return _program("arm-none-eabi-gcc"), _program("qemu-system-arm")


def _program(*names: str) -> str:
    found = next((path for name in names if (path := shutil.which(name))), None)
    return found or _missing(names[0])


def _missing(what: str) -> NoReturn:
    (pytest.fail if os.environ.get("MIDDECK_NO_SKIP") == "1" else pytest.skip)(f"no {what} on this machine")


class FewDoctests:
    """Of two thousand files those without an example are not searched for one, by each worker."""

    @pytest.hookimpl(wrapper=True)
    def pytest_collect_file(self, file_path):
        """The collectors of a file."""
        found = yield
        return [c for c in found if type(c).__name__ != "DoctestModule" or b">>>" in file_path.read_bytes()]


def pytest_configure(config):
    """Whole files in the long form leave their results, to be committed; some of their tests leave none."""
    config.pluginmanager.register(FewDoctests())
    some = config.option.keyword or config.option.markexpr or any("::" in a for a in config.args)
    # With several workers (-n), the one process that reports has no `workerinput`.
    if LONG and not some and not hasattr(config, "workerinput"):
        config.pluginmanager.register(LongResults(SEED))
