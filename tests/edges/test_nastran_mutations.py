"""Mutated decks: an article whose numbers are those of the text, or an error that says where."""

import random
import re
from decimal import Decimal

import numpy as np
import pytest

from cpu_limit import cpu_limit
from middeck.errors import MiddeckError
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units

DECK = """\
SOL 103
CEND
SPC = 7
BEGIN BULK
PARAM   COUPMASS1
MAT1           16.894+10             .33   2.7+3
PBAR,1,1,2.-4,1.-9,2.-9,2.-9
GRID           1
GRID           2              1.     .25
GRID*                  3                             1.5             2.3*
*                    .75
CORD2R,5,,0.,0.,0.,0.,0.,1.,+C
+C,1.,0.,0.
GRID,4,5,2.,,-.5
CBAR          11       1       1       2      0.      1.     .10
CBAR,12,1,2,3,0.,1.,.5
RBE2,13,3,123456,4
CONM2,14,4,,2.5,,,,,+
+,.1,,.1,,,.1
SPC1,8,123,1
SPC1,7,1235,1
PBUSH,5,K,1.+5,2.+5,3.+5,4.+2
CBUSH,21,5,2,4,0.,0.,1.
CELAS2,22,250.,3,5
FORCE,6,4,5,2.,.5,-1.
ENDDATA
"""
# Other cards: what is left after a slip is converted, or refused where it stands.
OTHERS = """\
SOL 103
CEND
MPC = 9
SPC = 3
LOAD = 30
K2GG = KAB
BEGIN BULK
MAT1,1,7.+10,,.3,2700.
PBARL          1       1             BOX
             .04     .03    .002    .003      .1
PBEAM,2,1,3.-4,4.-8,5.-8,,6.-8,.1,+B
+B,,,,,,,,,+C
+C,NO,1.,2.-4,3.-8,4.-8,,5.-8,.1,+D
+D,0.,0.
CORD2C,3,,1.,2.,3.,1.,2.,4.
,2.,2.,3.
CORD1R,4,1,2,3
GRDSET,,,,,,0
GRID,1,,0.,0.,0.
GRID,2,,1.,0.,0.,3
GRID,3,3,.5,30.,1.
GRID,4,4,.2,.4,1.,3,4
GRID,5,,1.,1.,1.
GRID,6,,1.,1.,1.5
CBAR,1,1,1,2,0.,1.,0.
,5,4
CBAR*,2,1,2,3
*,5
CBEAM,3,2,3,4,.3,1.,0.,GGG
,,,.01,0.,.02
CBAR,4,1,4,5,1.,.2,0.
CONM1,11,3,,2.,,2.
,2.,,,,.1
,,.1,,,,,,.1
CONM2,12,1,0,1.
CONM2,13,2,,1.
SPOINT,501,THRU,502
CELAS2,21,300.,501,0,2,3
CELAS4,22,200.,501,502
CMASS2,23,.5,501
CMASS4,24,.25,502
RBE3,31,,6,123,1.,123,3,4,+E
+E,5,.5,12,2
CONM2,32,6,,.3
SPC1,3,456,6
RBAR,33,2,5,123456,,,123
MPC,9,501,,1.,3,2,-.5
SPCADD,3,4,5
SPC1,4,12,1
SPC,5,1,3,0.
GRAV,21,4,9.81,0.,0.,-1.
FORCE,22,4,3,2.,1.
MOMENT,22,5,0,.3,0.,1.
LOAD,30,1.,1.,21,.5,22
DMIG,KAB,0,6,2,0
DMIG*,KAB,1,1
*,1,1,1000.
CBUSH,41,42,1,5,,,,0
PBUSH,42,K,1.+4,2.+4,,1.+2
ENDDATA
"""
REAL = re.compile(r"([+-]?(?:\d+\.\d*|\.\d+))(?:[ED]?([+-]\d+)|[ED](\d+))?$", re.ASCII)
BEGIN = re.compile(r"^\s*BEGIN(?:\s*[,=]?\s*BULK.*|\s+SUPER.*|\s*(?:\$.*)?)$", re.IGNORECASE | re.MULTILINE)
INTEGER = re.compile(r"[+-]?\d+$", re.ASCII)
# What a blank field gives where that is not nothing: the place of an elastic point, and its axes.
BLANKS = {("CBUSH", 8): 0.5, ("CBUSH", 9): -1}
STRESS_POINTS = range(8, 16)  # fields of a PBAR that no stiffness depends on
LONGEST = 5.0  # seconds for one deck, of some milliseconds
MARKS = " 0123456789.+-*,$EDeAGCB'\t\n/="


def mutated(seed, text):
    """A few slips of the hand: letters, lines and lengths."""
    rng = random.Random(seed)
    for _ in range(rng.randint(1, 3)):
        at = rng.randrange(len(text))
        lines = text.split("\n")
        line = rng.randrange(len(lines))
        match rng.randrange(8):
            case 0 | 1:
                text = text[:at] + rng.choice(MARKS) + text[at + 1 :]
            case 2:
                text = text[:at] + rng.choice(MARKS) + text[at:]
            case 3 | 4:
                text = text[:at] + text[at + rng.randint(1, 8) :]
            case 5:
                other = rng.randrange(len(lines))
                lines[line], lines[other] = lines[other], lines[line]
                text = "\n".join(lines)
            case 6:
                text = "\n".join(lines[: line + 1] + lines[line:])
            case _:
                text = text[:at] if rng.random() < 0.3 else "\n".join(lines[:line] + lines[line + 1 :])
        text = text or " "
    return text


def plainly(text):
    """The cards of bulk data by name, read anew and simply; None where that is not simple."""
    body = BEGIN.split(text, maxsplit=1)[-1]
    found, last, mark = {}, None, ""
    for line in re.split(r"(?im)^\s*ENDDATA", body)[0].split("\n"):
        line = line.split("$")[0].upper()
        if not line.strip():
            continue
        if "," in line:
            head, *fields = (part.strip() for part in line.split(","))
            count = 4 if "*" in head else 8
            fields, following = fields[:count], "".join(fields[count:])
        else:
            line = line.expandtabs(8)
            width = 16 if "*" in line[:8] else 8
            head, fields = line[:8].strip(), [line[i : i + width].strip() for i in range(8, 72, width)]
            following = line[72:].strip()
        if "=" in (head, *fields):
            return None  # as on the card before: `test_nastran_replication`
        if head[:1] in ("", "+", "*"):
            if last is None or head[1:] not in ("", mark):
                return None
            last += [""] * (-len(last) % (4 if "*" in head else 8)) + fields
        else:
            last = list(fields)
            found.setdefault(head.rstrip("* "), []).append(last)
        mark = following[1:]
    return found


def number(text):
    mantissa, signed, plain = REAL.match(text).groups()
    return float(Decimal(mantissa).scaleb(int(signed or plain or 0)))


def is_value(value, written):
    """Whether ``value`` is what a field says: an integer, a real, a name, or components in any order."""
    if isinstance(value, int):
        return INTEGER.match(written) is not None and value == int(written)
    if isinstance(value, float):
        return REAL.match(written) is not None and value == number(written)
    return value == written or sorted(value or "") == sorted(written) or (value, written) == ("", "0")


def is_card(entry, fields):
    """Whether every field of a card was read as it is written, and none that is not."""
    *values, last = entry.values
    values += last if isinstance(last, list) else [last]
    width = max(len(values), len(fields))
    pairs = zip(values + [None] * (width - len(values)), fields + [""] * (width - len(fields)), strict=True)
    return all(
        is_value(value, written)
        if written
        else value in (None, 0, "") or value == BLANKS.get((entry.name, place))
        for place, (value, written) in enumerate(pairs)
        if entry.name != "PBAR" or place not in STRESS_POINTS
    )


def compare(deck, text):
    """No card is read that is not written, and none that is written is lost or read as another."""
    cards = plainly(text)
    if cards is None:
        return
    idle = {name: count for name, count in deck.entries.idle.items() if count}
    read = {name: entries for name, entries in deck.entries.by_name.items() if entries}
    assert cards.keys() == read.keys() | idle.keys(), text
    assert all(len(cards[name]) == count for name, count in idle.items()), text
    for name, entries in read.items():
        for fields in cards[name]:
            assert any(is_card(entry, fields) for entry in entries), (name, fields, text)
        for entry in entries:
            assert any(is_card(entry, fields) for fields in cards[name]), (entry.values, text)


def compare_article(document, text):
    """Nodes stand where their grids do, and bushings have the stiffness of theirs."""
    cards = plainly(text)
    if cards is None or any("".join(row[1:2]) not in ("", "0") for row in cards.get("GRDSET", [])):
        return
    rows = {(name, canonical(row[0])): row + [""] * 16 for name in cards for row in cards[name]}
    for node in document["node"]:
        _, cp, *x = rows.get(("GRID", node["name"].removeprefix("g")), ["", "none"])[:5]
        if cp in ("", "0"):
            assert [node[f"{axis}_m"] for axis in "xyz"] == [real_or_zero(v) for v in x], text
    for bushing in document.get("bushing", []):
        element = rows.get(("CBUSH", bushing["name"].removeprefix("bush")))
        if element:
            _, first, *k = rows["PBUSH", canonical(element[1] or element[0])]
            if first == "K":
                assert list(bushing["stiffness"]) == [real_or_zero(v) for v in k[:6]], text


def canonical(written):
    return str(int(written)) if INTEGER.match(written) else written


def real_or_zero(written):
    return number(written) if written else 0.0


SI = parse_units("m-kg-s-N")


def judge(path, text):
    """Whether the deck was converted; its numbers are then those of its text."""
    path.unlink(missing_ok=True)  # some disks wait for what is written over a file
    path.write_text(text, newline="")
    try:
        with cpu_limit(LONGEST):
            deck = read_deck(path)
            made = convert_deck(deck, SI, "consistent", "a")
    except MiddeckError as error:
        located = "a.dat:" in str(error)
    else:
        return agrees(deck, made, text)
    assert located
    return False


def agrees(deck, made, text):
    assert all(np.all(np.isfinite(v)) for node in made.document["node"] for v in list(node.values())[1:])
    compare(deck, text)
    compare_article(made.document, text)
    return True


@pytest.mark.parametrize(
    ("deck", "whole", "least"), [(DECK, 100_000, 0.1), (OTHERS, 20_000, 0.05)], ids=["cards", "other cards"]
)
def test_mutated_decks(tmp_path, campaign, deck, whole, least):
    path = tmp_path / "a.dat"
    assert plainly(deck)
    assert judge(path, deck)
    seeds = campaign(whole)
    converted = sum(judge(path, mutated(seed, deck)) for seed in seeds)
    # Comments, blanks and digits leave a deck whole; most slips do not.
    assert least < converted / len(seeds) < 0.7


def test_what_runs_in_circles_is_ended():
    def circle():
        while True:
            pass

    with pytest.raises(pytest.fail.Exception, match="still running"), cpu_limit(0.01):
        circle()
