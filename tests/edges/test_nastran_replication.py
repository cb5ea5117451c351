"""Replicated cards against the same cards written out, and what replication leaves open."""

import pytest

from middeck.errors import ConfigError
from middeck.files.nastran.deck.deck import read_deck

HEAD = "SOL 103\nCEND\nBEGIN BULK\n"


def values(tmp_path, *lines):
    """Name, fields and lines of every card that is read."""
    (tmp_path / "a.dat").write_text(HEAD + "\n".join([*lines, "ENDDATA", ""]))
    entries = read_deck(tmp_path / "a.dat").entries
    return {name: [entry.values for entry in found] for name, found in entries.by_name.items()}


GRIDS = ["GRID,101,17,1.0,10.5,,17,3456", "GRID,102,17,1.2,10.6,,17,3456", "GRID,103,17,1.4,10.7,,17,3456"]
GRIDS += ["GRID,104,17,1.6,10.8,,17,3456", "GRID,105,17,1.8,10.9,,17,3456"]
BARS = [f"CBAR,{k},1,{k},{k + 1},0.,1.,0." for k in range(1, 8)]


@pytest.mark.parametrize(
    ("short", "long"),
    [
        # The example of the Quick Reference Guides, in either form of its numbers.
        ([GRIDS[0], "=,*(1),=,*(0.2),*(0.1),==", "=(3)"], GRIDS),
        ([GRIDS[0], "=,*1,=,*0.2,*0.1,==", "=3"], GRIDS),
        ([GRIDS[0], "=(4),*(1),=,*(0.2),*(0.1),=="], GRIDS),
        ([GRIDS[0], "GRID,*1,=,*.2,*1.-1,==", "=3"], GRIDS),
        (["grid   ,101,17,1.0,10.5,,17,3456", "= , *1 , = , *2.0-1 , *1.D-1 , ==", "=3 $ three more"], GRIDS),
        ([BARS[0], "=,*1,=,*1,*1,==", "=5"], BARS),
        ([BARS[0], "=6,*1,=,*1,*1,=,=,="], BARS),
        (["CBAR           1       1       1       2      0.      1.      0.", "=,*1,=,*1,*1,==", "=5"], BARS),
        ([BARS[0], "=       *1      =       *1      *1      ==", "=5"], BARS),
        # Down again, over zero, with values of its own between.
        (["GRID,9,,1.,,2.", "=,*-4,,*-1.5,=,3."], ["GRID,9,,1.,,2.", "GRID,5,,-.5,,3."]),
        # Each from the one before: a second pattern begins where the first ended.
        (
            ["GRID,1,,0.", "=,*1,=,*1.", "=1", "=,*10,=,=,1."],
            ["GRID,1,,0.", "GRID,2,,1.", "GRID,3,,2.", "GRID,13,,2.,1."],
        ),
    ],
)
def test_replicated_cards_are_those_written_out(tmp_path, short, long):
    assert values(tmp_path, *short) == values(tmp_path, *long)


@pytest.mark.parametrize(
    ("lines", "line", "words"),
    [
        (["=,*1"], 4, "there is no card before to repeat"),
        (["GRID,1", "=3"], 5, "no line before says what to add from card to card"),
        (["GRID,1", "=,*1", "GRID,9", "=3"], 7, "no line before says what to add"),
        (["GRID,1", "=,*1.5"], 5, "'1.5' cannot be added to '1'"),
        (["GRID,1", "=,*1,,*1."], 5, "'1.' cannot be added to ''"),
        (["GRID,1,,1.", "=,*1,,*1"], 5, "'1' cannot be added to '1.'"),
        (["GRID,1,,1.", "=,*(1,,*1"], 5, "cannot be added"),
        (["GRID,1,,1.", "=,*1,==,*1."], 5, "== stands for all fields that follow"),
        (["GRID,1,,1.", "=0,*1,=="], 5, "so many replications must be 1 to"),
        (["GRID,1,,1.", "=999999999,*1,=="], 5, "so many replications must be 1 to"),
        (["GRID,1,,1.", "=x,*1,=="], 5, "replication is = or =n in the first field"),
        (["GRID,1,,1.", "= *1 = *.2"], 5, "replication is = or =n in the first field"),
        (["GRID,1,,1.", "CBAR,2,=,=,3"], 5, "it repeats fields of a GRID, the card before"),
        (["CONM2,1,1,,2.\n+,1.", "=,*1,=="], 6, "replication of a card with continuations"),
        (["GRID*,1,,1.", "=,*1,=="], 5, "replication of a card with continuations or large fields"),
        (["CONM2,1,1,,2.", "=,*1,==\n+,1."], 5, "replication with a continuation"),
        (["CONM2,1,1,,2.\n+,=", "GRID,1"], 4, "replication with a continuation"),
        (["GRID,1,,1.", "=,%(9),=="], 5, "must be an integer > 0"),
    ],
)
def test_forms_that_are_not_read_say_so(tmp_path, lines, line, words):
    with pytest.raises(ConfigError) as error:
        values(tmp_path, *lines)
    assert f"a.dat:{line}: " in str(error.value)
    assert words in str(error.value)


def test_equals_signs_of_other_cards_stay(tmp_path):
    found = values(tmp_path, "GRID,1", "DEQATN,10,F(A,B),=,A+B")
    assert list(found) == ["GRID"]
