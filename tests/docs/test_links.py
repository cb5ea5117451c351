"""What the pages point to is there, and no tracked text betrays the machine it was written on."""

from __future__ import annotations

import re
import subprocess
import sys

from doc_pages import ROOT, tracked

PAGES = tracked("*.md")
LINK = re.compile(r"\[[^\]]*\]\(([^)\s]+)\)")
TEST_FILE = re.compile(r"`(tests/[\w/-]+(?:\.py|/))`")
# Homes, workplaces and temporary folders; addresses of hosts. A path in a regular expression is no path; four
# numbers are no address where they are a version of OpenSeesPy.
PLACES = re.compile(
    r"(?<![\w.~/-])/(?:home|root|work|mnt|Users|tmp)/[\w.-]+|\blocalhost:\d+|\b(?!3\.7\.1\.2\b)(?:\d{1,3}\.){3}\d{1,3}\b"
)
# What every match of `PLACES` has within it, and few texts have: found many times faster.
NEEDED = re.compile(r"/(?:home|root|work|mnt|Users|tmp)/|localhost:\d|\.\d{1,3}\.\d{1,3}\.\d")
REGISTRIES = re.compile(
    r"https?://[\w.-]*(?:pypi|pythonhosted|artifactory|nexus|proxy|index)[\w.-]*", re.IGNORECASE
)


def test_internal_links_resolve():
    for page in PAGES:
        check_links(page)


def check_links(page):
    text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
    for target in LINK.findall(text):
        if "://" in target or target.startswith("mailto:"):
            continue
        file, _, anchor = target.partition("#")
        there = (page.parent / file).resolve() if file else page
        assert there.exists(), f"{page.name}: {target}"
        if anchor:
            headings = re.findall(r"^#+ (.+)$", there.read_text(encoding="utf-8"), re.MULTILINE)
            slugs = {re.sub(r"[^\w -]", "", h).strip().lower().replace(" ", "-") for h in headings}
            assert anchor in slugs, f"{page.name}: {target}"


def test_test_files_that_pages_name_exist():
    for page in PAGES:
        for name in TEST_FILE.findall(page.read_text(encoding="utf-8")):
            assert (ROOT / name).exists(), f"{page.name} names {name}"


def test_no_line_of_a_page_is_a_comment():
    """A line that begins with a per cent sign is a comment in MyST: the manual would lack it."""
    for page in PAGES:
        text = re.sub(r"```.*?```", "", page.read_text(encoding="utf-8"), flags=re.DOTALL)
        lost = re.findall(r"^ *%.*", text, re.MULTILINE)
        assert not lost, f"{page.name}: {lost}"


def test_every_page_of_the_manual_is_in_its_index():
    index = (ROOT / "docs" / "index.md").read_text(encoding="utf-8")
    entries = re.findall(r"^([\w*/-]+)$", index, re.MULTILINE)
    reached = {p.resolve() for entry in entries for p in (ROOT / "docs").glob(f"{entry}.md")}
    explained = ROOT / "docs" / "explanation"
    reported = LINK.findall((explained / "index.md").read_text(encoding="utf-8"))
    reached |= {(explained / target).resolve() for target in reported}
    assert {p.resolve() for p in tracked("docs/*.md")} - reached == {ROOT / "docs" / "index.md"}


def test_the_manual_builds_without_a_warning(tmp_path):
    """References between pages and markup; as `make docs` does but for HTML and quotes, which take longer."""
    command = [sys.executable, "-m", "sphinx", "-q", "-W", "-b", "dummy", "-d", str(tmp_path / "trees")]
    command += ["-D", "smartquotes=0"]
    done = subprocess.run(
        [*command, str(ROOT / "docs"), str(tmp_path / "none")], capture_output=True, text=True, timeout=120
    )
    assert done.returncode == 0, done.stderr


def test_no_tracked_text_names_a_machine_or_a_registry():
    found = []
    for path in tracked():
        if path.suffix in (".npz", ".svg", ".uff", ".op4", ".other", ".mat") or path.samefile(__file__):
            continue
        text = path.read_text(encoding="utf-8")
        if match := (NEEDED.search(text) and PLACES.search(text)) or REGISTRIES.search(text):
            number = text.count("\n", 0, match.start()) + 1
            found.append(f"{path.relative_to(ROOT)}:{number}: {match[0]}")
    assert not found, "\n".join(found)
