"""Events of a scene as a list that can be shown, plotted and made a table of."""

from collections.abc import Iterable
from dataclasses import fields
from typing import Any

import numpy as np

from cnnum import sharing
from cnnum.scenes.events import Event


class EventList(list[Event]):
    """A list of events.

    Parameters
    ----------
    events : iterable of Event
    """

    def __init__(self, events: Iterable[Event] = ()) -> None:
        super().__init__(events)

    def __repr__(self) -> str:
        kinds = [event.title for event in self]
        counted = ", ".join(f"{kinds.count(kind)} {kind}" for kind in dict.fromkeys(kinds))
        return f"EventList({counted or 'empty'})"

    def _repr_html_(self) -> str:
        rows = [
            (f"{event.time:.3f} s", event.title, str(event).partition(", ")[2]) for event in self
        ]
        return sharing.table(f"{len(self)} events", ("time", "event", "about"), rows)

    def plot(self, ax: object = None) -> object:
        """Draw a mark for every event over time, a row a kind, and return the axes."""
        from cnnum import sharing

        return sharing.marks([event.title for event in self], [event.time for event in self], ax)

    def to_dataframe(self) -> Any:
        """Return a `pandas.DataFrame` with a row an event (extra `tables`)."""
        return sharing.data_frame(self._columns())

    def to_xarray(self) -> Any:
        """Return an `xarray.Dataset` along the axis "event" (extra `tables`)."""
        variables = {name: (("event",), values) for name, values in self._columns().items()}
        return sharing.dataset(variables, {}, {})

    def _columns(self) -> dict[str, Any]:
        """Return a column for each field; a value that an event lacks is NaN or empty."""
        columns: dict[str, Any] = {}
        for name in (field.name for field in fields(Event)):
            values: list[Any] = [getattr(event, name) for event in self]
            if name == "where":
                for place, axis in enumerate(("row", "column")):
                    columns[axis] = np.array([v[place] if v else np.nan for v in values])
            elif name in ("kind", "phase", "unit"):
                columns[name] = np.array([value or "" for value in values], dtype=np.str_)
            else:
                columns[name] = np.array([np.nan if v is None else v for v in values])
        return columns
