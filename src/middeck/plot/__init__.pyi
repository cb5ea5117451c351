"""Names of this room that ``middeck`` itself does not have."""

from .amplitude import draw_amplitude as draw_amplitude
from .authority import draw_authority as draw_authority
from .gimbal_family import draw_gimbal_family as draw_gimbal_family
from .nichols import draw_nichols as draw_nichols
from .nyquist import draw_nyquist as draw_nyquist
from .shapes import draw_shapes as draw_shapes

__all__: list[str]
