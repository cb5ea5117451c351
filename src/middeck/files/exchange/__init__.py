"""Systems, plants and compensators to and from python-control, scipy.signal and MATLAB.

Nothing of theirs is imported until a function here is called. In the files and objects of others a
compensator keeps the sign of this house, u = K y added at the plant's input, unless ``negative_feedback``
says that the other side subtracts: then K is negated on its way.
"""
