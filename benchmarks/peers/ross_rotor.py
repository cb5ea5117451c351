"""The overhung disc of `rotor.py` by ROSS: its element matrices, the wall's coordinates struck out.

ROSS has bearings and no clamp; a bearing stiff enough to be one would round to what is left.
"""

import json
import sys

import numpy as np
import ross
import scipy.linalg as sla

given = json.loads(sys.argv[1])
width = 0.03
steel = ross.Material(name="steel", rho=1e-9, E=given["EI"] / (np.pi * width**4 / 64.0), G_s=8e10)
shaft = ross.ShaftElement(
    L=given["length"],
    idl=0.0,
    odl=width,
    material=steel,
    shear_effects=False,
    rotary_inertia=False,
    gyroscopic=False,
)
disc = ross.DiskElement(n=1, m=given["mass"], Id=given["across"], Ip=given["polar"])
rotor = ross.Rotor([shaft], [disc], [ross.BearingElement(n=0, kxx=1.0, cxx=0.0)])
per = rotor.number_dof
free = per + np.array([0, 1, 3, 4] if per == 6 else range(per))  # bending of the second node
M, K, G = (np.asarray(part)[np.ix_(free, free)] for part in (rotor.M(0.0), rotor.K(0.0), rotor.G()))
found = []
for speed in given["speeds"]:
    n = len(M)
    A = np.block([[np.zeros((n, n)), np.eye(n)], [-np.linalg.solve(M, K), -np.linalg.solve(M, G) * speed]])
    s = sla.eigvals(A)
    found.append(sorted(np.imag(s)[np.imag(s) > 0.0].tolist()))
print(json.dumps({"version": ross.__version__, "whirl": found}))
