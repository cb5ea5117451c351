"""What forms of parts with axes of their own have in common."""

from __future__ import annotations

import numpy as np
from jaxtyping import Float

from middeck.errors import ConfigError
from middeck.files.toml.form import Form, Vector

# Sine between the two axes below which they are one: rounding decides where the third is.
APART = 1e-6


class AxesForm(Form):
    """Axes of its own in W; their lengths do not matter."""

    x_axis: Vector = (1.0, 0.0, 0.0)
    y_axis: Vector = (0.0, 1.0, 0.0)

    def axes(self, where: str) -> Float[np.ndarray, "3 3"]:
        """Unit vectors as columns, y in the plane of both; raises `ConfigError` where the two are one."""
        x, y = np.array(self.x_axis), np.array(self.y_axis)
        across = np.cross(x, y)
        if not np.linalg.norm(across) > APART * np.linalg.norm(x) * np.linalg.norm(y):
            raise ConfigError(
                f"x_axis {x.tolist()} and y_axis {y.tolist()} make no plane",
                where=where,
                hint="two vectors in different directions; lengths do not matter",
            )
        x, z = x / np.linalg.norm(x), across / np.linalg.norm(across)
        return np.column_stack([x, np.cross(z, x), z])
