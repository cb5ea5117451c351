"""Two superelements of NX Nastran, joined: its frequencies; from their bulk data its boundary stiffness."""

import random
import re
import shutil
from pathlib import Path

import numpy as np
import pytest
import scipy.linalg as sla
import scipy.sparse as sp

import middeck as md
from cli_runner import middeck
from middeck.errors import MiddeckError
from middeck.files.articles.document import document_text
from middeck.files.nastran.article.convert import convert_deck
from middeck.files.nastran.components.assembly import read_assembly
from middeck.files.nastran.components.external import read_external
from middeck.files.nastran.deck.deck import read_deck
from middeck.files.nastran.deck.units import parse_units
from middeck.files.nastran.output4.matrices import op4_by_name, write_op4
from middeck.structure.model.component import body_of, warnings_on_component

DATA = Path("data/nastran-superelement")
UNITS = parse_units("mm-kg-s-mN")
MARKS = " 0123456789.+-*,$EDeAGCB'\t\n/="
BOUNDARY = ["g3", "g11", "g19", "g27"]


def external(name):
    return read_external([DATA / f"{name}.pch"], DATA / f"{name}.op4", UNITS, name=name)


@pytest.fixture(scope="module")
def answer():
    text = (DATA / "assemble.out.txt").read_text()
    rows = [
        line.split() for line in text.splitlines() if re.fullmatch(r"\s+\d+\s+\d+(\s+\S+E[+-]\d\d){5}", line)
    ]
    return np.array([float(row[3]) / (2.0 * np.pi) for row in rows])


def test_the_assembly_has_nastrans_frequencies(tmp_path, capfd, answer):
    article = tmp_path / "assembly.toml"
    ended = middeck(capfd, "convert", str(DATA / "assemble.dat"), "--units", "mm-kg-s-mN", "-o", str(article))
    assert ended.code == 0
    assert "assemble.dat:31: MPC = 701: there is no MPC of this number" in ended.out  # NX: warning 2047
    structure = md.load_structure(article)
    modes = md.solve_modes(md.solve_equilibrium(structure, md.Environment.orbit()))
    assert len(modes.omega) == len(answer) == 54
    assert np.all(modes.frequency_hz[:6] < 1e-3)
    np.testing.assert_allclose(modes.frequency_hz[6:], answer[6:], rtol=1e-6)
    assert modes.warnings == ()
    assert structure.mass == pytest.approx(3.345436, rel=1e-6)


def in_units(folder, length, mass):
    """The assembly as written in units of ``length`` mm and ``mass`` kg, modal masses again one."""

    def over(columns, line):
        for start in columns:
            line = f"{line[:start]}{float(line[start : start + 16]) / length:16.9E}{line[start + 16 :]}"
        return line

    for name in ("inboard", "outboard"):
        for ending in ("asm", "pch"):
            lines = (DATA / f"{name}.{ending}").read_text().splitlines()
            for k in [k for k, line in enumerate(lines) if line.startswith("GRID*")]:
                lines[k], lines[k + 1] = over((40, 56), lines[k]), over((8,), lines[k + 1])
            (folder / f"{name}.{ending}").write_text("\n".join(lines) + "\n")
        found = {key: m for key, m in op4_by_name(DATA / f"{name}.op4").items() if key in ("KXX", "MXX")}
        S = np.full(found["KXX"].value.shape[0], 1.0)  # modal coordinates, whose masses are 1
        S[:24] = np.tile(np.repeat([1.0, 1.0 / length], 3), 4) / np.sqrt(mass)
        scaled = [
            found[key]._replace(value=found[key].value.multiply(np.outer(S, S))) for key in ("KXX", "MXX")
        ]
        write_op4(folder / f"{name}.op4", [m._replace(value=sp.csc_array(m.value)) for m in scaled])
    text = (DATA / "assemble.dat").read_text()
    moved = ",".join(f"{x / length:.9f}" for x in (340.0, -630.0, 110.0))
    for old, new in (
        ("340.,-630.,110.", moved),
        ("9990002,0,1.0", f"9990002,0,{length * np.sqrt(mass):.9f}"),
    ):
        assert old in text
        text = text.replace(old, new)
    (folder / "assemble.dat").write_text(text)
    return folder / "assemble.dat"


LBF = 4.4482216152605


@pytest.mark.parametrize(
    ("units", "length", "mass"),
    [("mm-t-s-N", 1.0, 1000.0), ("in-slinch-s-lbf", 25.4, LBF / 0.0254)],
)
def test_superelements_in_other_units_have_the_same_frequencies(tmp_path, capfd, answer, units, length, mass):
    deck = in_units(tmp_path, length, mass)
    ended = middeck(capfd, "convert", deck, "--units", units, "-o", tmp_path / "a.toml")
    assert ended.code == 0, ended.err
    assert "modal masses" not in ended.out
    modes = md.solve_modes(
        md.solve_equilibrium(md.load_structure(tmp_path / "a.toml"), md.Environment.orbit())
    )
    np.testing.assert_allclose(modes.frequency_hz[6:], answer[6:], rtol=1e-6)
    assert md.load_structure(tmp_path / "a.toml").mass == pytest.approx(3.345436, rel=1e-6)


def test_a_held_assembly_is_that_of_its_matrices_with_rows_struck_out(tmp_path, capfd):
    for name in ("inboard.asm", "outboard.asm", "inboard.pch", "outboard.pch", "inboard.op4", "outboard.op4"):
        shutil.copy(DATA / name, tmp_path)
    text = (DATA / "assemble.dat").read_text()
    held = text.replace("METHOD = 1", "METHOD = 1\nSPC = 7", 1).replace("$RBE2", "SPC1,7,123456,3\n$RBE2", 1)
    assert held.count("SPC") == text.count("SPC") + 2
    (tmp_path / "held.dat").write_text(held)
    ask = ("convert", tmp_path / "held.dat", "--units", "mm-kg-s-mN", "-o", tmp_path / "a.toml")
    ended = middeck(capfd, *ask)
    assert ended.code == 2  # nowhere to write the clamps to
    assert not list(tmp_path.glob("*.npz"))
    assert middeck(capfd, *ask, "--environment", tmp_path / "e.toml").code == 0
    modes = md.solve_modes(md.solve_equilibrium(*md.load_setup(tmp_path / "a.toml", tmp_path / "e.toml")), 12)
    parts = external("inboard"), external("outboard")
    assert parts[0].grids == parts[1].grids == ("3", "11", "19", "27")
    size = 24 + sum(part.modal for part in parts)
    K, M = np.zeros((size, size)), np.zeros((size, size))
    for part, start in zip(parts, (24, 24 + parts[0].modal), strict=True):
        at = np.ix_(*[np.r_[0:24, start : start + part.modal]] * 2)
        K[at] += part.stiffness
        M[at] += part.mass
    lam = np.sort(np.abs(1.0 / sla.eigvals(M[6:, 6:], K[6:, 6:]).real))  # the mass may be singular
    np.testing.assert_allclose(modes.omega[:12] ** 2, lam[:12], rtol=1e-7)


def test_each_component_is_a_body():
    inboard, outboard = external("inboard"), external("outboard")
    assert (inboard.modal, outboard.modal) == (8, 22)
    assert body_of(inboard).mass + body_of(outboard).mass == pytest.approx(3.345436, rel=1e-6)


def slipped(text, seed):
    """A few slips of the hand: letters, lines and lengths."""
    rng = random.Random(seed)
    for _ in range(rng.randint(1, 3)):
        at, lines = rng.randrange(len(text)), text.split("\n")
        match rng.randrange(5):
            case 0 | 1:
                text = text[:at] + rng.choice(MARKS) + text[at + 1 :]
            case 2:
                text = text[:at] + rng.choice(MARKS) + text[at:]
            case 3:
                text = text[:at] + text[at + rng.randint(1, 8) :]
            case _:
                i, j = rng.randrange(len(lines)), rng.randrange(len(lines))
                lines[i], lines[j] = lines[j], lines[i]
                text = "\n".join(lines)
    return text


def bits_flipped(content, seed):
    """In the stiffness and the mass."""
    rng, out = random.Random(seed), bytearray(content)
    for _ in range(rng.randint(1, 2)):
        out[rng.randrange(17000)] ^= 1 << rng.randrange(8)
    return bytes(out)


def test_damaged_files_are_refused_or_change_nothing(tmp_path, campaign):
    """Cards and matrices; what may differ is a number that stands nowhere twice: a modal stiffness."""
    for file in DATA.iterdir():
        shutil.copy(file, tmp_path / file.name)
    deck, good = tmp_path / "assemble.dat", None
    for seed in (None, *campaign(240)):
        name = random.Random(seed).choice(["assemble.dat", "inboard.asm", "outboard.pch", "inboard.op4"])
        content = (DATA / name).read_bytes()
        if seed is not None:
            new = (
                bits_flipped(content, seed)
                if name.endswith("op4")
                else slipped(content.decode(), seed).encode()
            )
            (tmp_path / name).write_bytes(new)
        try:
            source, read = read_assembly(deck, UNITS, "a")
            parts = convert_deck(source, UNITS, "coupled", "a", read).components
        except MiddeckError:
            assert seed is not None
            continue
        finally:
            (tmp_path / name).write_bytes(content)
        good = good or parts
        assert {p.grids for p in parts.values()} == {p.grids for p in good.values()}
        for was, now in zip(good.values(), parts.values(), strict=True):
            for key in ("stiffness", "mass"):
                a, b = getattr(was, key), getattr(now, key)
                size = np.sqrt(np.abs(np.diagonal(a)))
                apart = np.abs(b - a) / np.outer(size, size) > 1e-3
                first = 6 * len(was.grids)
                assert not np.any(apart[:first, :first])
                if np.any(apart):
                    assert name == "inboard.op4"
                    doubted = [*warnings_on_component(now)]
                    alone = np.count_nonzero(apart) == np.count_nonzero(np.diagonal(apart))
                    assert doubted or (alone and key == "stiffness")


def reduced(tmp_path, name, single):
    deck = read_deck(DATA / f"{name}.blk", single=single)
    document = convert_deck(deck, UNITS, "coupled", name).document
    (tmp_path / "a.toml").write_text(document_text(document, ""))
    return md.reduce_structure(md.load_structure(tmp_path / "a.toml"), BOUNDARY, upto_hz=50.0)


@pytest.mark.parametrize("name", ["inboard", "outboard"])
def test_boundary_stiffness_from_the_bulk_data(tmp_path, name):
    theirs = external(name)
    # NX keeps properties in single precision (PBAR in its table EPT): 12.566 mm^2 is off by 1.04e-8 there.
    for single, tolerance in ((False, 1.05e-8), (True, 1e-12)):
        ours = reduced(tmp_path, name, single)
        K, M = (getattr(ours.component, key)[:24, :24] for key in ("stiffness", "mass"))
        size = np.sqrt(np.diagonal(theirs.stiffness)[:24])
        assert np.abs((K - theirs.stiffness[:24, :24]) / np.outer(size, size)).max() < tolerance
        assert np.abs(M - theirs.mass[:24, :24]).max() < max(1e-9, 10.0 * tolerance) * np.abs(M).max()
    # Modal coordinates are not unique; those of fixed-interface modes have frequencies, which are.
    kept = len(ours.fixed_hz)
    squared = np.diagonal(theirs.stiffness)[24:] / np.diagonal(theirs.mass)[24:]
    np.testing.assert_allclose(ours.fixed_hz, np.sqrt(squared[:kept]) / (2.0 * np.pi), rtol=2e-7)
    assert ours.next_hz > 50.0


def assembled(folder, main=(), within=()):
    """The assembly with more cards in its main bulk data, or in the section of its first superelement."""
    for name in ("inboard.asm", "outboard.asm", "inboard.pch", "outboard.pch", "inboard.op4", "outboard.op4"):
        shutil.copy(DATA / name, folder)
    text = (DATA / "assemble.dat").read_text().replace("$RBE2", "\n".join([*main, "$RBE2"]), 1)
    (folder / "assemble.dat").write_text(text)
    with (folder / "inboard.pch").open("a") as file:
        file.write("".join(f"{card}\n" for card in within))
    source, parts = read_assembly(folder / "assemble.dat", UNITS, "a")
    return convert_deck(source, UNITS, "consistent", "a", parts)


@pytest.mark.parametrize(
    ("main", "within", "words"),
    [
        (["SELOC,100,1,2,3,4,5,6"], [], "assemble.dat:"),
        (["SELOC,100,1,2,3,4,5,6"], [], "SELOC 100: it puts a superelement elsewhere, which is not read"),
        (["SEMPLN,100,PLANE,1,2,3"], [], "SEMPLN 100: it mirrors a superelement, which is not read"),
        (["SEBULK,100,PRIMARY,,AUTO"], [], "SEBULK 100: a superelement of type PRIMARY of none is not read"),
        (["SEBULK,100,MIRROR,200,AUTO"], [], "a superelement of type MIRROR of 200 is not read"),
        (["RELEASE,100,13,3"], [], "RELEASE 100: it parts a superelement from the rest"),
        (["SEBNDRY,100,200,3"], [], "SEBNDRY 100: it says which grids of superelements are joined"),
        ([], ["SELOC,100,1,2,3,4,5,6"], "inboard.pch:"),
        ([], ["CONM2,9,3,,1."], "CONM2 9: in superelement 102, of which its matrices alone are read"),
        ([], ["SPC1,7,123456,3"], "SPC1 7: in superelement 102, of which its matrices alone are read"),
    ],
)
def test_what_places_superelements_is_refused(tmp_path, main, within, words):
    with pytest.raises(MiddeckError) as error:
        assembled(tmp_path, main, within)
    assert words in str(error.value)


def test_what_divides_a_model_changes_nothing_and_is_listed(tmp_path):
    (tmp_path / "one").mkdir()
    (tmp_path / "two").mkdir()
    plain, divided = assembled(tmp_path / "one"), assembled(tmp_path / "two", ["SESET,1,3,11", "SEELT,1,5"])
    assert document_text(plain.document, "") == document_text(divided.document, "")
    why = "which superelement something is in: the article is not divided"
    assert {("SESET", 1, why), ("SEELT", 1, why)} <= set(divided.left_out)
