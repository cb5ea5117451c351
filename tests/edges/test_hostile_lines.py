"""Hostile command lines of the verbs about packages: refused with a reason, nothing written, no traceback."""

from __future__ import annotations

import hashlib
import json
import shlex
import shutil
from pathlib import Path

import numpy as np
import pytest

from cli_runner import ROOT, middeck
from middeck.control.law.compensator import Compensator
from middeck.files.articles.components import write_component
from middeck.files.laws.blacklists import write_blacklist
from middeck.files.laws.compensators import write_compensator
from middeck.files.laws.packages import write_package
from middeck.files.measured.models import write_model
from middeck.files.nastran.components.external_write import write_external
from middeck.identification.model.plant_model import model_of_plant
from middeck.realtime.package.package_law import package_law
from middeck.signals.ports import Port
from middeck.structure.model.component import Component
from middeck.systems.plants.plant import Plant
from middeck.systems.state_space.statespace import SampledStateSpace, StateSpace

LINES = """
2 | generate law.json -o out                                     | no ending says what to write
2 | generate law.json -o out.txt                                 | no writer for '.txt' files
2 | generate law.json -o folder.mdk                              | is a folder, not a file
2 | generate law.json -o nowhere/x.mdk                           | no such folder
2 | generate law.json -o law.mdk/x.mdk                           | no such folder
2 | generate law.json -o /proc/x.mdk                             | /proc/x.mdk: No such file
2 | generate law.json -o                                         | middeck generate --help
2 | generate law.json -o 3.c                                     | -o 3.c: the C name '3'
2 | generate law.json -o ./law.json                              | would be written over law.json
2 | generate twin.json -o twin.json                              | would be written over twin.json
2 | generate law.json -o a.mdk -o ./a.mdk                        | would be written over -o a.mdk
2 | generate                                                     | Missing argument
2 | generate law.json cont.json                                  | unexpected extra argument
4 | generate none.json -o a.mdk                                  | cannot be read
4 | generate folder.mdk -o a.mdk                                 | looks like a folder
4 | generate empty.json -o a.mdk                                 | the file is empty
4 | generate cut.mdk -o a.mdk                                    | cut short
4 | generate later.json -o a.mdk                                 | this reader knows 'middeck.package/1'
4 | generate strange.json -o a.mdk                               | not UTF-8 text
4 | generate nan.json -o a.mdk                                   | A: a number is not finite
4 | generate deep.json -o a.mdk                                  | tables within tables without end
4 | generate round.json -o a.mdk                                 | cannot be read
4 | generate model.json -o a.mdk                                 | looks like a fitted model
2 | generate cont.json -o a.mdk                                  | --rate HZ
2 | generate cont.json --rate nan -o a.mdk                       | not a finite number
2 | generate cont.json --rate inf -o a.mdk                       | not in the range
2 | generate cont.json --rate -5 -o a.mdk                        | not in the range
2 | generate cont.json --rate 500 --rate 500 -o a.mdk            | given twice
2 | generate cont.json --rate 500 --rule zoh -o a.mdk            | is not one of
2 | generate law.json --rate 250 -o a.mdk                        | sampled at 500 Hz
2 | generate law.json --limit 1,2 -o a.mdk                       | 2 limits for 1 ports
2 | generate law.json --limit -1 -o a.mdk                        | lower <= 0 <= upper
2 | generate law.json --range 1e308 --limit 1 -o a.mdk           | not a finite number
2 | generate law.json --slew 1e-320 -o a.mdk                     | not a finite number
2 | generate law.json --ramp nan -o a.mdk                        | not a finite number
2 | generate law.json --single --form dense -o a.mdk             | --single with --form dense
2 | generate law.json --name "a b" -o a.mdk                      | letters, digits
2 | generate law.mdk --limit 2 -o a.mdk                          | cannot be given again
4 | gate law.json model.json --paper                             | looks like a compensator
4 | gate cut.mdk model.json --paper                              | cut short
4 | gate model.json law.mdk --paper                              | looks like a fitted model
2 | gate law.mdk law.mdk --paper                                 | looks like a controller package
4 | gate law.mdk twin.json --paper                               | looks like a controller package
2 | gate name.mdk model.json --paper                             | the model has no such output
1 | gate unit.mdk model.json --paper                             | reads way in mm, the plant has it in m
1 | gate slow.mdk model.json --engaged law.mdk --phase-deg 9 --paper | not for this engine
1 | gate law.mdk model.json --delay-ms 1e6 --paper               | a delay of 5e+05 periods
2 | gate law.mdk model.json --delay-ms 1e9 --paper               | not in the range
2 | gate law.mdk model.json --delay-ms nan --paper               | not a finite number
2 | gate law.mdk model.json --noise nan                          | not a finite number
2 | gate law.mdk model.json --disturbance -1                     | not in the range
2 | gate law.mdk model.json --share 0                            | not in the range
2 | gate law.mdk model.json --gain-db inf --paper                | not a finite number
2 | gate law.mdk model.json --shift 0.5:2 nan --paper            | not a finite number
2 | gate law.mdk model.json --shift 90:99 5 --paper              | no mode between 90 and 99 Hz
2 | gate law.mdk model.json --environment lab --paper            | --environment is for articles
2 | gate law.mdk model.json --set a=1 --paper                    | --set is for articles
2 | gate law.mdk model.json --sweep --paper                      | first bending
4 | gate law.mdk survey/promise.json --paper                     | names no file of its plants
2 | gate law.mdk model.json --paper --rig-port 5000              | --paper with a rig
2 | gate law.mdk model.json --rig-port 70000                     | not in the range
2 | gate law.mdk model.json --driver none.c                      | cannot be read
2 | gate law.mdk model.json --driver binary.c                    | not UTF-8 text
2 | gate law.mdk model.json --hold way push                      | requires 3 arguments
2 | gate law.mdk model.json --hold way push nan --paper          | not a finite number
2 | gate law.mdk model.json --hold none push -1 --paper          | no sensor 'none'
2 | gate law.mdk model.json --engaged unit.mdk --paper           | way in m of one package, in mm of another
4 | gate law.mdk model.json --engaged cut.mdk --paper            | cut short
4 | gate law.mdk model.json --blacklist edited.json --paper      | not what was sealed
4 | gate law.mdk model.json --blacklist lost.json --paper        | cannot be read
4 | gate law.mdk model.json --blacklist round.json --paper       | cannot be read
2 | gate law.mdk model.json -o model.json --paper                | would be written over model.json
2 | gate law.mdk model.json --engaged twin.json -o twin.json     | would be written over --engaged twin.json
2 | gate law.mdk model.json --blacklist b.json -o b.json         | would be written over --blacklist b.json
2 | gate law.mdk model.json -o /proc/v.json --paper              | /proc/v.json: No such file
2 | gate law.mdk model.json -o v.json -o w.json                  | given twice
2 | doctor                                                       | --realtime
2 | doctor --realtime --rate nan                                 | not a finite number
2 | doctor --realtime --seconds nan                              | not a finite number
2 | doctor --realtime --states 2000                              | not in the range
2 | doctor --realtime --processor 99999999999                    | processor of 99999999999
2 | doctor --realtime --set a=1                                  | takes no keys
4 | qualify law.mdk model.json                                   | looks like a controller package
4 | qualify model.json law.json                                  | looks like a fitted model
2 | qualify law.json model.json --rate 100                       | no form at another rate
2 | qualify cont.json model.json --rate 1e-9                     | from 1e-6 to 1e9
2 | qualify law.json model.json --angle-noise 1e200              | not a finite number
2 | qualify law.json model.json --disturbance 1e-200             | not a finite number
2 | qualify law.json model.json --delay-ms 1e6                   | a delay of 5e+05 periods
2 | qualify law.json model.json --require gain_db=nan            | stable, or one of
2 | qualify law.json model.json --figure a.txt                   | no writer
2 | promise articles/mace-simple.toml                            | neither a plan nor load cases
2 | promise articles/mace-simple.toml p.toml --load-cases p.toml | a plan and load cases at once
2 | promise articles/mace-simple.toml model.json                 | not the plan of a promise
2 | promise survey/promise.toml articles/mace-simple.toml        | looks like an article
2 | promise articles/mace-simple.toml survey/cut.toml            | survey/cut.toml
2 | promise articles/mace-simple.toml survey/promise.toml --date 2026-02-30               | is no date
2 | promise articles/mace-simple.toml survey/promise.toml --plants plants.json           | in the same folder
2 | promise articles/mace-simple.toml survey/promise.toml -o survey/mace-simple-lab.json | be written over
2 | refine articles/mace-simple.toml survey/refine.toml -o articles/mace-simple.toml | be written over
2 | outcome survey/promise.json survey/outcome.toml -o survey/mace-simple-orbit.json | be written over
2 | reduce whole.toml --boundary n1 --modes 1 -o part.npz        | -o part.npz: would be written over part
2 | reduce other.toml --boundary n1 --modes 1 -o other.npz       | -o other.npz: would be written over
"""  # fmt: skip
CASES = [[part.strip() for part in line.split(" | ")] for line in LINES.strip().splitlines()]
WHOLE = """schema = 1
name = "whole"
[[node]]
name = "n1"
x_m = 0.0
mass_kg = 1.0
inertia_kg_m2 = [1.0, 1.0, 1.0]
[[component]]
name = "part"
file = "{}"
nodes = {{1 = "n1"}}
"""
WAY, PUSH = Port("way", "m"), Port("push", "N")


def lag(reads: Port = WAY, period_s: float = 0.002) -> Compensator:
    return Compensator(
        SampledStateSpace([[0.9]], [[1.0]], [[5.0]], [[-50.0]], period_s=period_s), (reads,), (PUSH,)
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Sound documents of every kind, and broken ones."""
    at = tmp_path_factory.mktemp("hostile")
    write_compensator(at / "law.json", lag())
    slow = Compensator(StateSpace([[-50.0]], [[1.0]], [[250.0]], [[-5.0]]), (WAY,), (PUSH,))
    write_compensator(at / "cont.json", slow)
    laws = {"law": lag(), "unit": lag(Port("way", "mm")), "name": lag(Port("there", "m")),
            "slow": lag(period_s=0.01)}  # fmt: skip
    for name, law in laws.items():
        write_package(at / f"{name}.mdk", package_law(law, name, input_range=0.1, limit=1.0, ramp_s=0.3))
    write_package(at / "twin.json", package_law(lag(), "law", input_range=0.1, limit=1.0))
    w = 2.0 * np.pi
    swing = StateSpace([[0.0, w], [-w, -0.02 * w]], [[0.0], [1.0]], [[1.0, 0.0]], [[0.0]])
    write_model(at / "model.json", model_of_plant(Plant(dynamics=swing, inputs=(PUSH,), outputs=(WAY,))))
    write_blacklist(at / "edited.json", {})
    mass, stiffness = np.diag([2.0, 2.0, 2.0, 1.0, 1.0, 1.0, 1.0]), np.diag([0.0] * 6 + [900.0])
    at_one = {"grids": ("1",), "frames": ("n1",), "positions": np.zeros((1, 3))}
    body = Component(name="part", stiffness=stiffness, mass=mass, **at_one)
    write_component(at / "part.npz", body)
    write_external(at / "other", body)
    shutil.copytree(ROOT / "articles", at / "articles")
    survey = shutil.copytree(ROOT / "data/virtual-survey", at / "survey")
    plan = (survey / "promise.toml").read_text()
    texts = {
        "later.json": json.dumps(
            {**json.loads((at / "twin.json").read_text()), "schema": "middeck.package/9"}
        ),
        "nan.json": (at / "law.json").read_text().replace("0.9", "NaN"),
        "deep.json": "[" * 100_000,
        "empty.json": "",
        "edited.json": (at / "edited.json").read_text().replace("{}", '{"aa": "b"}'),
        "whole.toml": WHOLE.format("part.npz"),
        "other.toml": WHOLE.format("other.op4") + 'cards = ["other.pch"]\nunits = "m-kg-s-N"\n',
        "survey/cut.toml": plan[: plan.index("[ladder]")],
    }
    for name, text in texts.items():
        (at / name).write_text(text)
    (at / "cut.mdk").write_bytes((at / "law.mdk").read_bytes()[:500])
    (at / "strange.json").write_bytes(b'{"schema": "\xff"}')
    (at / "binary.c").write_bytes(b"\x00\xff" * 40)
    (at / "folder.mdk").mkdir()
    (at / "round.json").symlink_to("round.json")
    (at / "lost.json").symlink_to("nowhere.json")
    return at


def contents(folder: Path) -> dict[str, str]:
    return {
        str(path): hashlib.sha256(path.read_bytes()).hexdigest() if path.is_file() else ""
        for path in folder.rglob("*")
    }


@pytest.mark.parametrize(("code", "line", "said"), CASES, ids=[case[1] for case in CASES])
def test_a_hostile_line_is_refused_and_writes_nothing(folder, monkeypatch, capfd, code, line, said):
    monkeypatch.chdir(folder)
    before = contents(folder)
    ended = middeck(capfd, *shlex.split(line))
    text = ended.out + ended.err
    assert (ended.code, said in text) == (int(code), True), text
    assert "Traceback" not in text
    assert code == "1" or (ended.out == "" and "try: " in ended.err)
    assert contents(folder) == before


def test_what_does_not_fit_into_memory_is_no_fault_of_the_program(folder, monkeypatch, capfd):
    def fail(*asked):
        raise MemoryError("Unable to allocate 1.73 EiB")

    monkeypatch.chdir(folder)
    monkeypatch.setattr("middeck.cli.given.plants_to_try.gather_plants", fail)
    ended = middeck(capfd, "gate", "law.mdk", "model.json")
    assert (ended.code, "1.73 EiB" in ended.err, "try: " in ended.err) == (5, True, True)
