"""Kind of a file by its content, for errors about a wrong file."""

import re
from collections.abc import Collection
from pathlib import Path

ARTICLE, ENVIRONMENT, STUDY, CHANNELS = "an article", "an environment", "a study", "a file of channels"
MODEL, LAW, SURVEY = "a fitted model", "a compensator", "the measured modes of a survey"
PROMISE, PACKAGE, RUN = "a promise", "a controller package", "a run of the engine"
BLACKLIST = "a blacklist of packages"
VERDICT = "a verdict of the gate"
REFINEMENT, CANDIDATES, PLAN = "a refinement", "a list of candidate tests", "the plan of a promise"
OUTCOME, LOADS, DRAWN = "an outcome", "promised load cases", "the plants of a promise"
COMPARED = "what came beside a promise"
FOLDER, EMPTY, BINARY, TEXT = "a folder", "an empty file", "a binary file", "plain text"
TABLE, ARCHIVE, ARRAY = "a table of numbers", "an archive of arrays (NPZ)", "one array (NPY)"
MAT, HDF5, UNIVERSAL = "a MATLAB file", "an HDF5 file", "a universal file"
JSON, TOML, NOT_UTF8 = "a JSON file", "a TOML file", "text that is not UTF-8"
PAGE, NUMBERS = "a drawing or a web page", "the numbers of a study"

# What no record looks like, whatever its ending; the reader of the ending speaks of the rest.
NO_RECORD = (
    ARTICLE,
    ENVIRONMENT,
    STUDY,
    CHANNELS,
    TOML,
    MODEL,
    LAW,
    SURVEY,
    PROMISE,
    PACKAGE,
    NUMBERS,
    JSON,
    PAGE,
    REFINEMENT,
    CANDIDATES,
    PLAN,
    OUTCOME,
    LOADS,
)
# What no Nastran deck looks like; case control has lines that TOML could have.
NO_DECK = frozenset(NO_RECORD) - {TOML}

HEAD = 65536
MAGIC = {
    b"PK\x03\x04": ARCHIVE,
    b"\x93NUMPY": ARRAY,
    b"\x89HDF\r\n": HDF5,
    b"MATLAB": MAT,
    b"MIDDECKP": PACKAGE,
    b"MIDDECKR": RUN,
    b"\xff\xfe": NOT_UTF8,
    b"\xfe\xff": NOT_UTF8,
}
SCHEMAS = {
    "model": MODEL,
    "compensator": LAW,
    "measured-modes": SURVEY,
    "promise": PROMISE,
    "package": PACKAGE,
    "blacklist": BLACKLIST,
    "gate": VERDICT,
    "refinement": REFINEMENT,
    "candidates": CANDIDATES,
    "promise-plan": PLAN,
    "outcome": OUTCOME,
    "promised-loads": LOADS,
    "promised-plants": DRAWN,
    "comparison": COMPARED,
}
PARTS = (
    "node",
    "strut",
    "gimbal",
    "revolute",
    "mesh",
    "material",
    "section",
    "actuator",
    "sensor",
    "damping",
)
# Tables and keys that only one kind of document has.
KEYS: dict[str, frozenset[str]] = {
    ARTICLE: frozenset(PARTS),
    ENVIRONMENT: frozenset(("constants", "device", "clamp")),
    STUDY: frozenset(("control", "rig", "figure_6", "siso", "sito", "promise", "mirror")),
    CHANNELS: frozenset(("channel",)),
}


def looks_like(path: str | Path) -> str:
    """The kind of the file at ``path`` in words; empty if it cannot be read."""
    file = Path(path)
    if file.is_dir():
        return FOLDER
    try:
        with open(file, "rb") as stream:
            head = stream.read(HEAD)
    except OSError:
        return ""
    if not head.strip():
        return EMPTY
    known = next((kind for magic, kind in MAGIC.items() if head.startswith(magic)), None)
    if known is not None:
        return known
    if re.match(rb"\s*-1\s*\r?\n", head):
        return UNIVERSAL
    if b"\x00" in head:
        return BINARY
    try:
        text = head.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        if len(head) < HEAD or error.start < HEAD - 4:  # not a letter that the end of the head cuts in two
            return NOT_UTF8 if re.search(rb"\w+", head[:80]) and not _is_noise(head) else BINARY
        text = head[: error.start].decode("utf-8-sig")
    return _text_kind(text.lstrip())


def _is_noise(head: bytes) -> bool:
    """Control characters that no text has."""
    return sum(byte < 9 or 13 < byte < 32 for byte in head) > 0.01 * len(head)


def _text_kind(text: str) -> str:
    if text.startswith("<"):
        return PAGE
    if text.startswith("{"):
        return _json_kind(text)
    if re.match(r"\[\s*[-\d{]", text):
        return JSON
    stated = re.search(r"^schema\s*=\s*\"middeck\.([\w-]+)/", text, re.MULTILINE)
    if stated is not None and stated[1] in SCHEMAS:
        return SCHEMAS[stated[1]]
    names = [m[1] for m in re.finditer(r"^\s*\[{1,2}\s*\"?([A-Za-z_]\w*)[^;,\t\n]*$", text, re.MULTILINE)]
    keys = [m[1] for m in re.finditer(r"^[ \t]*(?!sep=.$)([A-Za-z_]\w*)[ \t]*=", text, re.MULTILINE)]
    scores = {kind: len(own & set(names)) for kind, own in KEYS.items()}
    best = max(scores, key=lambda kind: scores[kind])
    if scores[best]:
        return best
    if keys or names:
        return TOML
    line = text.splitlines()[0]
    return TABLE if re.search(r"[,;\t]", line) or re.fullmatch(r"[-+.\deE\s]+", line) else TEXT


def _json_kind(text: str) -> str:
    found = re.search(r'"schema"\s*:\s*"middeck\.([\w-]+)/', text)
    if found is not None:
        return SCHEMAS.get(found[1], f"what middeck {found[1]} --json prints")
    return NUMBERS if '"figures"' in text and '"versions"' in text else JSON


def stray(path: str | Path, wanted: str, passing: Collection[str]) -> str:
    """Why ``path`` is not ``wanted``: empty where it looks like that, or like one of the kinds ``passing``.

    Those are kinds that the reader itself can say more of. A file that is not there is left to it as well.
    """
    kind = looks_like(path)
    return "" if not kind or kind == wanted or kind in passing else f"looks like {kind}, not {wanted}"


def is_json(path: str | Path) -> bool:
    """Whether the file begins as a JSON document does."""
    if Path(path).is_dir():
        return False
    with open(path, "rb") as stream:
        return stream.read(HEAD).removeprefix(b"\xef\xbb\xbf").lstrip().startswith((b"{", b"["))
