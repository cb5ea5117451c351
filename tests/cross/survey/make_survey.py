"""Write the surveys of this folder with pyuff (2.5.8), which the package does not need: python make_survey.py

Three modes at five nodes: real and complex, in metres and millimetres, in data sets 55 and 2414.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pyuff

HERE = Path(__file__).parent
HZ, ZETA, NODES = [4.25, 11.5, 30.0625], [0.01, 0.015, 0.002], [1, 2, 3, 4, 5]


def motions(count):
    """motion[mode, node, direction] drawn from one seed."""
    rng = np.random.default_rng(55)
    return rng.standard_normal((3, 5, count)) + 1j * rng.standard_normal((3, 5, count))


def places():
    return np.random.default_rng(15).uniform(-1.0, 1.0, (5, 3))


def write(name, sets):
    path = HERE / name
    path.unlink(missing_ok=True)
    file = pyuff.UFF(str(path))
    for data in sets:
        file._write_set(data, "add")


def units(code, length):
    return pyuff.prepare_164(
        units_code=code,
        units_description="",
        temp_mode=1,
        length=length,
        force=1.0,
        temp=1.0,
        temp_offset=273.15,
    )


def nodes(kind, metre):
    x, y, z = metre * places().T
    prepare = {15: pyuff.prepare_15, 2411: pyuff.prepare_2411}[kind]
    one = [1] * 5
    return prepare(node_nums=NODES, def_cs=one, disp_cs=one, color=one, x=x, y=y, z=z)


def trace():
    return pyuff.prepare_82(trace_num=1, n_nodes=5, color=30, id="bus", nodes=np.array(NODES))


def shapes(count, metre, *, normal):
    for k, shape in enumerate(motions(count)):
        motion = shape.real if normal else shape
        motion = motion * np.array([metre] * 3 + [1.0] * (count - 3))
        common = dict(
            model_type=1,
            id1="NONE",
            id2="NONE",
            id3="NONE",
            id4="NONE",
            id5="NONE",
            data_ch=2 if count == 3 else 3,
            spec_data_type=8,
            data_type=2 if normal else 5,
            n_data_per_node=count,
            load_case=1,
            mode_n=k + 1,
            node_nums=NODES,
            **{f"r{a + 1}": motion[:, a] for a in range(count)},
        )
        omega = 2 * np.pi * HZ[k]
        if normal:
            yield pyuff.prepare_55(
                analysis_type=2, freq=HZ[k], modal_m=1.0, modal_damp_vis=ZETA[k], modal_damp_his=0.0, **common
            )
        else:
            root = omega * (-ZETA[k] + 1j * np.sqrt(1.0 - ZETA[k] ** 2))
            yield pyuff.prepare_55(analysis_type=3, eig=root, modal_a=1.0 + 0j, modal_b=1.0 + 0j, **common)


if __name__ == "__main__":
    write("normal-m.unv", [units(1, 1.0), nodes(2411, 1.0), trace(), *shapes(3, 1.0, normal=True)])
    write("normal-mm.unv", [units(5, 1e3), nodes(15, 1e3), *shapes(6, 1e3, normal=True)])
    write("complex-m.unv", [units(1, 1.0), nodes(2411, 1.0), *shapes(3, 1.0, normal=False)])
