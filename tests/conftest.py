"""One thread for BLAS, seeded campaigns, and skips that CI does not allow."""

import datetime
import json
import os
import shutil
from pathlib import Path

# Before numpy is imported: small matrices gain nothing from threads, and bytes depend on their number.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

import pytest  # noqa: E402
from hypothesis import settings  # noqa: E402

from middeck.files.studies import load_study  # noqa: E402

LONG = os.environ.get("MIDDECK_LONG") == "1"
SEED = 1993
SHARE = 20  # `make test` runs a twentieth of each campaign

# Independent programs with environments of their own; nothing here imports them.
collect_ignore = ["cross/sheet_by_autodiff", "cross/suspended_bus", "cross/uff"]
collect_ignore_glob = ["cross/*/make_*.py"]

settings.register_profile("short", max_examples=20, derandomize=True, deadline=None)
settings.register_profile("long", max_examples=20 * SHARE, derandomize=True, deadline=None)
settings.load_profile("long" if LONG else "short")


@pytest.fixture(scope="session")
def campaign():
    """``campaign(whole)``: seeds of ``whole`` runs, of which the first twentieth unless all are asked for."""

    def seeds(whole: int) -> range:
        return range(SEED, SEED + (whole if LONG else max(1, whole // SHARE)))

    return seeds


@pytest.hookimpl(tryfirst=True)  # before the workers put the group into the names
def pytest_collection_modifyitems(items):
    """Files stay whole on a worker; those that need the paper's study share one, which then runs it once."""
    shared = {item.path for item in items if "paper_outcomes" in getattr(item, "fixturenames", ())}
    for item in items:
        item.add_marker(pytest.mark.xdist_group("paper" if item.path in shared else str(item.path)))


@pytest.fixture(scope="session")
def paper_study():
    """The study of the paper as it is shipped."""
    return load_study(Path(__file__).parents[1] / "studies/mace-1993.toml")


@pytest.fixture(scope="session")
def paper_outcomes(paper_study):
    """Its chapters but the mirror, which has its own tests and takes long; once a session."""
    from middeck.study.mission import run_chapters  # with matplotlib, which few tests need

    return {name: run() for name, run in run_chapters(paper_study) if name != "mirror"}


@pytest.fixture(scope="session")
def chromium():
    """Path of a real browser; without one the test is skipped, which CI turns into a failure."""
    return _program("chromium", "chromium-browser", "google-chrome")


def _program(*names: str) -> str:
    found = next((path for name in names if (path := shutil.which(name))), None)
    if found is None:
        message = f"no {names[0]} on this machine"
        (pytest.fail if os.environ.get("MIDDECK_NO_SKIP") == "1" else pytest.skip)(message)
    return found


def pytest_sessionfinish(session, exitstatus):
    """`make test-all` leaves its result, to be committed."""
    # With several workers (-n), the one process that reports has no `workerinput`.
    if LONG and not hasattr(session.config, "workerinput"):
        reporter = session.config.pluginmanager.get_plugin("terminalreporter")
        counts = {k: len(reporter.stats.get(k, [])) for k in ("passed", "failed", "error", "skipped")}
        result = {"date": datetime.date.today().isoformat(), "seed": SEED, "exit": int(exitstatus), **counts}
        (Path(__file__).parent / "results.json").write_text(json.dumps(result, indent=1) + "\n")
