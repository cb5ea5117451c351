"""Systems, plants and compensators to and from python-control, scipy.signal and MATLAB.

Nothing of theirs is imported until a function here is called. In the files and objects of others a
compensator keeps the sign of this house, u = K y added at the plant's input, unless ``negative_feedback``
says that the other side subtracts: then K is negated on its way.
"""

from middeck.files.exchange.mat import load_mat, write_mat
from middeck.files.exchange.named import as_compensator, exchanged
from middeck.files.exchange.python_control import from_control, to_control
from middeck.files.exchange.scipy_signal import from_scipy, to_scipy

__all__ = [
    "as_compensator",
    "exchanged",
    "from_control",
    "from_scipy",
    "load_mat",
    "to_control",
    "to_scipy",
    "write_mat",
]
