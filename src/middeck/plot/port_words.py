"""Ports in words: the angle, rate or torque behind a name of the two articles."""

from middeck.systems.plants.response import FrequencyResponse

CARRIER = {"pri": "", "sec": "secondary "}
KIND = {"in": "payload", "rel": "gimbal"}


def port_words(name: str) -> str:
    """Body, axis and ``rate`` of a port; the name itself where it follows no such pattern.

    >>> port_words("pri_in_z_rate"), port_words("bus_x_rate"), port_words("sec_rel_z"), port_words("tip")
    ('payload z rate', 'bus x rate', 'secondary gimbal z', 'tip')
    """
    match name.removesuffix("_rate").split("_"):
        case ["bus", axis]:
            body = "bus"
        case [carrier, kind, axis] if carrier in CARRIER and kind in KIND:
            body = CARRIER[carrier] + KIND[kind]
        case _:
            return name
    return f"{body} {axis}" + (" rate" if name.endswith("_rate") else "")


def path_words(response: FrequencyResponse) -> str:
    """From the only input to the only output of a response, in words."""
    return f"{port_words(response.inputs[0].name)} torque to {port_words(response.outputs[0].name)} angle"
