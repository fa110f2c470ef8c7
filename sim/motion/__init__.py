"""Motion of the rig: what every motion is; smooth curves, heads, recorded trajectories."""

from __future__ import annotations

from typing import Protocol

import numpy as np
from numpy.typing import NDArray


class Motion(Protocol):
    """A smooth curve of the body's pose; the body's axes are camera 0's: right, down, forward."""

    def T_world_body(self, t_s: float) -> NDArray[np.float64]:
        """Pose (4, 4) at time `t_s`, seconds from the start of the sequence; world z is up."""
        ...
