"""Names that the tables of an article define, by kind; the tables need not fit the form."""

from middeck.files.toml.tables import Table, array_of, table_of, tables


def named_tables(data: Table, key: str) -> dict[str, Table]:
    """The sub-tables of table ``key`` by name."""
    return {name: t for name, t in table_of(data, key).items() if isinstance(t, dict)}


def names_in(data: Table, key: str) -> list[str]:
    """Names in the array of tables ``key``."""
    return [str(t["name"]) for _, t in tables(data, key) if "name" in t]


def joint_names(data: Table) -> list[str]:
    """Names of the joints: two for a gimbal, one for a revolute or a proof mass."""
    return [*axis_names(data), *names_in(data, "proof_mass")]


def axis_names(data: Table) -> list[str]:
    """Names of the axes of gimbals and revolutes."""
    gimbals = [f"{t['name']}_{a}" for _, t in tables(data, "gimbal") if "name" in t for a in "xz"]
    return gimbals + names_in(data, "revolute")


def attach_names(data: Table) -> list[str]:
    """Names of the attach points: the suspension's nodes and the listed ones."""
    return [*map(str, array_of(table_of(data, "suspension"), "nodes")), *names_in(data, "attach")]


def hanging_names(data: Table) -> list[str]:
    """Attach points that a suspension may take: all but the listed ones where a spring or bushing ends."""
    ties = [t for key in ("spring", "bushing") for _, t in tables(data, key)]
    ends = {str(t.get(end)) for t in ties for end in ("from", "to")}
    own = set(map(str, array_of(table_of(data, "suspension"), "nodes")))
    return [name for name in attach_names(data) if name in own or name not in ends]


def damped_names(data: Table) -> dict[str, list[str]]:
    """Names of what may be damped, by key."""
    springs = [str(t.get("name", f"{t.get('from')}-{t.get('to')}")) for _, t in tables(data, "spring")]
    return {
        "joint": axis_names(data),  # a proof mass has its own damping, not in N m s/rad
        "spring": springs,
        "attach": attach_names(data),
        "material": list(named_tables(data, "material")),
        "section": list(named_tables(data, "section")),
    }
