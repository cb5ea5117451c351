"""Studies: the form of their files, and the rig and the promise that they describe."""
