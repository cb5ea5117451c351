"""Sentences and tables of promise and outcome."""

from middeck.study.chapters.promise.numbers_and_claims import frequency_error, median_error_db
from middeck.study.chapters.promise.numbers_and_claims import routes as by_route
from middeck.study.words import Line, Numbers, Table, fixed, percent, significant

SECTION = "promise"
REST_HZ = 0.005  # below which a growing pole is no oscillation
ROUTES = {
    "sheet": "nominal model",
    "refined": "model refined on 1-g records",
    "measured": "fit to a record from orbit",
}


def promise(figures: Numbers) -> str:
    """Accuracy of the promise."""
    numbers = figures["promise"]
    score, apart = numbers["score"], median_error_db(numbers)
    decibels = (
        ""
        if apart is None
        else " The promised median rms of a loop differs from that on the rig in orbit by"
        f" {fixed(apart, 2)} dB (median of the compensators)."
    )
    set_ups = "one set-up" if len(numbers["tests"]) == 1 else f"{len(numbers['tests'])} set-ups"
    return (
        f"The model is refined on records of {set_ups} in 1-g alone. Its error of the first"
        f" {len(numbers['frequencies']['true_hz'])} flexible frequencies in orbit is"
        f" {significant(frequency_error(numbers, 'refined_hz'), 2)} % rms (nominal model:"
        f" {significant(frequency_error(numbers, 'sheet_hz'), 2)} %).{decibels} Of {score['count']} outcomes"
        f" {percent(score['coverage'], 0)} are within their promised 95 % intervals."
    )


def routes(figures: Numbers) -> str:
    """Results of the three designs."""
    numbers = figures["promise"]
    law, top = numbers["ground_law"], {key: values[-1] for key, values in by_route(numbers).items()}
    reached = ", ".join(f"{ROUTES[key]} {_decibel(db)}" for key, db in top.items())
    pole = f"a pole at {fixed(law['growth_hz'], 2)} Hz" if law["growth_hz"] >= REST_HZ else "a real pole"
    turned = (
        "A compensator for all motors designed on the 1-g record is stable in 1-g, but unstable in orbit with"
        f" {pole}: a fitted model includes gravity and suspension, which cannot be removed from it."
        if law["stable_on_the_ground"] and not law["stable_in_orbit"]
        else "A compensator for all motors designed on the 1-g record is"
        f" {'stable' if law['stable_in_orbit'] else 'unstable'} in orbit."
    )
    return f"Rms on the rig in orbit at the highest authority, by model of the design: {reached}. {turned}"


def _decibel(db: float | None) -> str:
    return "unstable" if db is None else f"{fixed(db, 1)} dB"


def result(figures: Numbers) -> Line:
    """Frequencies and decibels, promised and measured."""
    numbers = figures["promise"]
    apart = median_error_db(numbers)
    loops = "" if apart is None else f"; rms of the loops {fixed(apart, 2)} dB in the median"
    error = significant(frequency_error(numbers, "refined_hz"), 2)
    count = len(numbers["frequencies"]["true_hz"])
    return Line(
        f"Error of the promise for 0-g, made from 1-g records: first {count}"
        f" flexible frequencies {error} % rms"
        f"{loops}.",
        SECTION,
    )


def shortfalls(figures: Numbers) -> list[Line]:
    """Outcomes outside their intervals."""
    missed = [name for name, verdict in figures["promise"]["verdicts"].items() if not verdict["inside"]]
    if not missed:
        return []
    return [Line(f"Outside their promised 95 % intervals: {', '.join(missed)}.", SECTION)]


def promise_tables(figures: Numbers) -> list[Table]:
    """Ground tests, compensators, and limits of the promise."""
    numbers = figures["promise"]
    tests = [
        [t["name"], str(t["modes"]), *(
            f"{significant(torque, 3)} / {fixed(t['slip_angle_deg'][joint], 4)}"
            for joint, torque in t["slip_torque_nm"].items()
        )]
        for t in numbers["tests"]
    ]  # fmt: skip
    joints = [
        f"{name}: slip torque [N m] / slip angle [deg]" for name in numbers["tests"][0]["slip_torque_nm"]
    ]
    limits = [[str(k), text] for k, text in enumerate(numbers["not_valid_for"], start=1)]
    return [
        Table("Ground tests", ("set-up", "modes used", *joints), tests),
        _loops_table(numbers),
        Table("What the promise is not valid for", ("", "limit"), limits),
    ]


def _loops_table(numbers: Numbers) -> Table:
    shares = list(numbers["shares"])
    came = {c["name"]: c for c in numbers["came"]}
    rows = [
        [
            c["name"],
            percent(c["probability_stable"], 1),
            f"{c['sweep']['stable']} of {c['sweep']['cases']}",
            *(_level(c["db"][shares.index(s)]) for s in (0.025, 0.5, 0.975)),
            _on_rig(came[c["name"]]),
            _level(came[c["name"]]["linear_db"]),
        ]
        for c in numbers["orbit"]["compensators"]
    ]
    head = ("compensator", "promised stable", "stable in the sweep", "2.5 % [dB]", "median [dB]",
            "97.5 % [dB]", "rig in orbit [dB]", "without friction and limits [dB]")  # fmt: skip
    return Table(f"Compensators: promise from {numbers['draws']} draws, and outcome on the rig", head, rows)


def _on_rig(came: Numbers) -> str:
    """Decibels measured on the rig, also where its limits alone bound a loop that grows."""
    db = came["rig_db"]
    return _level(db) if came["stable"] or db is None else f"unstable; {fixed(db, 2)} at its limits"


def _level(db: float | None) -> str:
    return "unstable" if db is None else fixed(db, 2)


def route_tables(figures: Numbers) -> list[Table]:
    """Decibels on the rig by kind of design."""
    numbers = figures["promise"]
    by = by_route(numbers)
    rows = [
        [fixed(level, 2), *(_level(by[key][k]) for key in ROUTES)]
        for k, level in enumerate(numbers["authority_log10"])
    ]
    head = ("log10 authority", *(f"{words} [dB]" for words in ROUTES.values()))
    return [Table("Rms on the rig in orbit, by model of the design", head, rows)]
