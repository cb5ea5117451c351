"""The score of many promises over comparisons that were sealed before."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from middeck.campaign.confidence_of_draws import probability_interval
from middeck.errors import DataError
from middeck.files.json.hash_seal import SEAL, read_sealed, seal
from middeck.files.promises.outcomes import COMPARISON
from middeck.files.promises.promise_documents import few, versions
from middeck.updating.promise.score import Kind, Verdict, score

SCORE = "middeck.score/1"
KINDS: tuple[Kind, ...] = ("mode", "reading", "compensator")


def score_document(paths: Sequence[str | Path], *, date: str) -> dict[str, Any]:
    """The sealed document of coverage, Brier's score and pessimism over the comparisons in ``paths``.

    Raises `DataError` for a file that is no comparison, was changed, or counts what another one counts too:
    one quantity of one promise.
    """
    found = [read_sealed(path, COMPARISON) for path in paths]
    verdicts: list[Verdict] = []
    counted: dict[tuple[str, str, str], str] = {}
    for path, document in zip(map(str, paths), found, strict=True):
        for verdict in _verdicts(document, path):
            key = document["promise"], verdict.kind, verdict.name
            if key in counted:
                raise DataError(
                    f"{verdict.name} of promise {key[0][:12]}... stands in {counted[key]} too",
                    where=path,
                    hint="each quantity of a promise once: what is counted twice weighs twice",
                )
            counted[key] = path
            verdicts.append(verdict)
    by_kind = {kind: [v for v in verdicts if v.kind == kind] for kind in KINDS}
    return seal(
        {
            "schema": SCORE,
            "date": date,
            "versions": versions(),
            "comparisons": [
                {"name": Path(path).name, SEAL: document[SEAL], "promise": document["promise"]}
                for path, document in zip(paths, found, strict=True)
            ],
            "score": _scored(verdicts),
            "by_kind": {kind: _scored(some) for kind, some in by_kind.items() if some},
        }
    )


def _scored(verdicts: Sequence[Verdict]) -> dict[str, Any]:
    found = score(verdicts)
    ends = probability_interval(sum(v.inside for v in verdicts), len(verdicts))
    return {
        "count": found.count,
        "coverage": few(found.coverage),
        "coverage_interval_95": [few(end) for end in ends],
        "brier": None if found.brier is None else few(found.brier),
        "pessimism_db": None if found.pessimism is None else few(found.pessimism),
        "lost": found.lost,
    }


def _verdicts(document: dict[str, Any], path: str) -> list[Verdict]:
    try:
        return [
            Verdict(
                kind=v["kind"],
                name=v["name"],
                inside=v["inside"],
                brier=v["brier"],
                pessimism=v["pessimism_db"],
            )
            for v in document["verdicts"]
        ]
    except (KeyError, TypeError) as error:  # sealed without being whole
        hint = "the comparison as `middeck outcome -o` wrote it"
        raise DataError(f"no verdicts: {error}", where=path, hint=hint) from None
