"""Events that are on the GPU as well."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from emvs.cuda import arrays
from emvs.data.events import Events


@dataclass(frozen=True, slots=True)
class DeviceEvents(Events):
    """Events of one camera, here and on the GPU.

    Attributes:
        there: columns x, y, t_us on the GPU.
    """

    there: tuple[Any, Any, Any] = (None, None, None)

    @classmethod
    def of(cls, events: Events) -> DeviceEvents:
        """Uploads events; those that are on the GPU stay as they are."""
        if isinstance(events, DeviceEvents):
            return events
        x, y, t_us = (arrays.up(column) for column in (events.x, events.y, events.t_us))
        return cls(events.x, events.y, events.t_us, events.p, (x, y, t_us))

    def slice(self, start: int, stop: int) -> DeviceEvents:
        """Events `start` to `stop` (exclusive), as views."""
        part = slice(start, stop)
        x, y, t_us = (column[part] for column in self.there)
        return DeviceEvents(self.x[part], self.y[part], self.t_us[part], self.p[part], (x, y, t_us))
