"""The plants of a promise as models of the gate and rows of `qualify`: through files, by their hash."""

import dataclasses
import json
import shutil
from pathlib import Path

import numpy as np
import pytest

from cli_runner import middeck, share_results
from coarse_articles import coarse
from middeck.cli.main import execute
from middeck.errors import DataError
from middeck.files.any_value import write
from middeck.files.json.hash_seal import SEAL, seal
from middeck.files.laws.packages import load_package
from middeck.files.promises.plans import load_plan
from middeck.files.promises.promise_file import read_promise
from middeck.files.promises.promise_plants import load_promised_plants
from middeck.realtime.package.filter_sections import LoopPath, static_gain
from middeck.realtime.package.vectors import add_test_vectors
from middeck.updating.promise.plan import group_loop
from middeck.updating.promise.promise import design_on

ROOT = Path(__file__).parents[2]
ARTICLE = coarse("mace-simple")
FOLDER = ROOT / "data/virtual-survey"
DRAWS = 3
LEVELS = (1, 6)
"""Of the ladder, log10: the lower one passes on every draw, the higher one has too little margin."""


@pytest.fixture(scope="module")
def promised(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A promise of two compensators in files, and its plants."""
    folder = tmp_path_factory.mktemp("promised")
    for name in ("refine.toml", "mace-simple-lab.json", "promise.toml"):
        text = (FOLDER / name).read_text(encoding="utf-8")
        text = text.replace("draws = 24 ", f"draws = {DRAWS} ").replace("bounded = 1", "bounded = 0")
        text = text.replace("[0.0, 3.0, 6.0]", str([float(x) for x in LEVELS]))
        (folder / name).write_text(text, encoding="utf-8")
    promise(folder, "first")
    plan = load_plan(folder / "promise.toml", ARTICLE).plan
    plants = load_promised_plants(folder / "first.json").plants
    assert plan.ladder is not None
    grouped = group_loop(plan, plants["orbit 0"], plan.ladder.drives, plan.ladder.reads)
    for name, law in design_on(grouped, plan.ladder, plan).items():
        write(folder / f"{name.replace(' ', '')}.json", law)
    more = "".join(f'\n[[law]]\nname = "{x}"\nfile = "LQG{x}.json"\n' for x in LEVELS)
    plan_file = folder / "promise.toml"
    plan_file.write_text(plan_file.read_text(encoding="utf-8") + more, encoding="utf-8")
    promise(folder, "promise")
    return folder


def promise(folder: Path, name: str) -> None:
    """``middeck promise`` with its plants beside it."""
    asked = ["promise", str(ARTICLE), str(folder / "promise.toml"), "--date", "2026-11-23"]
    asked += ["-o", str(folder / f"{name}.json"), "--plants", str(folder / f"{name}-plants.json")]
    with pytest.MonkeyPatch.context() as patch:
        share_results(patch)
        assert execute(asked, lambda: False) == 0


def generate(capfd: pytest.CaptureFixture[str], folder: Path, level: int) -> Path:
    """A compensator of the promise as a package."""
    law = folder / f"LQG{level}.mdk"
    asked = (law.with_suffix(".json"), "--rate", "500", "--range", "0.2", "--limit", "1", "-o", law)
    made = middeck(capfd, "generate", *asked)
    assert made.code == 0, made.err
    return law


def gate(capfd: pytest.CaptureFixture[str], folder: Path, level: int, *more: str) -> dict:
    """The verdict on it, on the promise's plants."""
    asked = ("--gain-db", "3", "--phase-deg", "20", "--json", *more)
    ended = middeck(capfd, "gate", generate(capfd, folder, level), folder / "promise.json", *asked)
    assert ended.code in (0, 1), ended.err
    return json.loads(ended.out)


def test_qualify_finds_on_the_promised_plants_what_was_promised(promised: Path, capfd):
    """Draw by draw: as many are stable as the promise counted."""
    (orbit,) = read_promise(promised / "promise.json")["environments"]
    loops = {loop["name"]: loop for loop in orbit["compensators"]}
    for level in map(str, LEVELS):
        ended = middeck(capfd, "qualify", promised / f"LQG{level}.json", promised / "promise.json", "--json")
        assert ended.code == 0, ended.err
        found = json.loads(ended.out)
        assert [row["plant"] for row in found["rows"]] == [f"promise: orbit {k}" for k in range(DRAWS)]
        assert found["stable"] == round(DRAWS * loops[level]["probability_stable"])
        assert not any("hold" in said for said in found["warnings"])  # none in continuous time


def test_the_gate_tries_a_package_on_every_promised_plant(promised: Path, capfd):
    """On paper and in dry runs; and the verdict says on which promise."""
    found = gate(capfd, promised, LEVELS[0], "--disturbance", "1e-4")
    assert found["passed"], found["steps"]
    assert found["models"] == [f"promise: orbit {k}" for k in range(DRAWS)]
    assert [s["name"] for s in found["steps"][-DRAWS:]] == [f"dry run {name}" for name in found["models"]]
    assert found["promises"] == [read_promise(promised / "promise.json")[SEAL]]


def test_one_promised_plant_is_enough_to_refuse(promised: Path, capfd):
    """And a hold in the plan's delays, which the package adds too, is asked for."""
    found = gate(capfd, promised, LEVELS[1], "--paper")
    (said,) = found["warnings"]
    assert "count in full, and sample and hold add 1 ms" in said
    assert not found["passed"]
    refused = found["steps"][-1]
    assert refused["name"].startswith("model promise: orbit"), refused


def test_a_hold_is_not_closed_twice(promised: Path, capfd):
    law = generate(capfd, promised, LEVELS[0])
    hold = ("--hold", "pri_in_z", "pri_rel_z", "-0.01")
    held = middeck(capfd, "gate", law, promised / "promise.json", "--paper", *hold)
    assert held.code == 2
    assert "--hold: the plants of the promise have an inner loop at pri_rel_z" in held.err


def test_an_inner_loop_of_a_package_is_not_closed_twice(promised: Path, capfd):
    law = promised / "looped.mdk"
    package = load_package(generate(capfd, promised, LEVELS[0]))
    paths = (LoopPath(0, 0, static_gain(-0.01)),)
    write(law, add_test_vectors(dataclasses.replace(package, paths=paths, vectors=None)))
    for packages in ((law,), (generate(capfd, promised, LEVELS[0]), "--engaged", law)):
        gated = middeck(capfd, "gate", *packages, promised / "promise.json", "--paper")
        assert gated.code == 2
        assert f"package {package.name}: the plants of the promise have an inner loop" in gated.err


def test_promises_of_one_name_are_all_tried(promised: Path, tmp_path: Path, capfd):
    """Of two in folders of their own, no plant takes the place of another's."""
    for name in ("promise.json", "promise-plants.json"):
        shutil.copy(promised / name, tmp_path / name)
    both = (promised / "promise.json", tmp_path / "promise.json")
    ended = middeck(capfd, "qualify", promised / f"LQG{LEVELS[0]}.json", *both, "--json")
    assert ended.code == 0, ended.err
    names = [row["plant"] for row in json.loads(ended.out)["rows"]]
    wanted = [f"{name}: orbit {k}" for name in ("promise", both[1]) for k in range(DRAWS)]
    assert names == wanted
    again = middeck(capfd, "qualify", promised / f"LQG{LEVELS[0]}.json", *both, both[1], "--json")
    assert again.code == 2
    assert f"{both[1]} is given again" in again.err


def test_plants_are_known_by_their_hash(promised: Path, tmp_path: Path):
    """Changed plants, those of another promise, and sealed ones that are none are refused."""
    found = load_promised_plants(promised / "promise.json")
    assert found.sha256 == read_promise(promised / "promise.json")[SEAL]
    for name in ("promise.json", "promise-plants.json"):
        shutil.copy(promised / name, tmp_path / name)
    again, plants = tmp_path / "promise.json", tmp_path / "promise-plants.json"
    text = plants.read_text(encoding="utf-8")
    number = str(found.plants["orbit 1"].delay_s.max())
    assert number in text
    plants.write_text(text.replace(number, number[:-1] + str((int(number[-1]) + 1) % 10), 1))
    with pytest.raises(DataError, match="not what was sealed"):
        load_promised_plants(again)
    other = {k: v for k, v in json.loads(text).items() if k != SEAL}
    other["plants"].popitem()
    plants.write_text(json.dumps(seal(other)))
    with pytest.raises(DataError, match="not the plants that"):
        load_promised_plants(again)
    plants.unlink()
    with pytest.raises(DataError, match=r"promise-plants\.json"):
        load_promised_plants(again)
    said = {k: v for k, v in json.loads(again.read_text(encoding="utf-8")).items() if k != SEAL}
    for wrong in ({}, {"orbit 0": 1}, {"orbit 0": {"inputs": []}}):
        if not wrong:
            del other["plants"]
        else:
            other["plants"] = wrong
        sealed = seal(other)
        plants.write_text(json.dumps(sealed))
        again.write_text(json.dumps(seal(said | {"plants": {"name": plants.name, SEAL: sealed[SEAL]}})))
        with pytest.raises(DataError, match=r"promise-plants\.json"):
            load_promised_plants(again)
    del said["plants"]
    again.write_text(json.dumps(seal(said)))
    with pytest.raises(DataError, match="names no file of its plants"):
        load_promised_plants(again)


def test_plants_are_those_that_were_drawn(promised: Path):
    """Every number whole: delays drawn within their tolerance, no two alike, ports of the plan."""
    plants = load_promised_plants(promised / "promise.json").plants
    delays = [np.unique(plant.delay_s) for plant in plants.values()]
    assert all(len(d) == 1 and 0.009 <= d[0] <= 0.011 for d in delays)
    assert len(np.unique(delays)) == DRAWS
    # The same seed draws the same plants for other compensators.
    assert load_promised_plants(promised / "first.json").plants == plants


def test_plants_need_a_promise_beside_them(promised: Path, tmp_path: Path, capfd):
    asked = ("promise", ARTICLE, promised / "promise.toml", "--plants", tmp_path / "plants.json")
    for more in ((), ("-o", promised / "elsewhere.json")):
        ended = middeck(capfd, *asked, *more)
        assert ended.code == 2
        assert "in the same folder" in ended.err
    assert not list(tmp_path.iterdir())
