"""Arrays as xarray datasets and pandas tables (extra `tables`)."""

from collections.abc import Mapping, Sequence
from importlib import import_module
from typing import Any

from cnnum.errors import missing_extra

Variables = Mapping[str, tuple[Sequence[str], Any]]
"""Name of a variable to the names of its axes, and its values."""


def dataset(variables: Variables, coordinates: Variables, facts: Mapping[str, object]) -> Any:
    """Return an `xarray.Dataset`.

    Raises
    ------
    MissingExtraError
        If xarray is not installed.
    """
    made = _library("xarray").Dataset(
        {name: (list(axes), values) for name, (axes, values) in variables.items()},
        coords={name: (list(axes), values) for name, (axes, values) in coordinates.items()},
    )
    made.attrs.update(facts)
    return made


def data_frame(columns: Mapping[str, Any]) -> Any:
    """Return a `pandas.DataFrame` of columns of one length.

    Raises
    ------
    MissingExtraError
        If pandas is not installed.
    """
    return _library("pandas").DataFrame(dict(columns))


def cell_columns(name: str, values: Any) -> dict[str, Any]:
    """Return columns of (frames, …) values: one a cell, as in "name[0, 3]"."""
    if values.ndim == 1:
        return {name: values}
    import numpy as np

    return {
        f"{name}[{', '.join(map(str, place))}]": values[(slice(None), *place)]
        for place in np.ndindex(values.shape[1:])
    }


def _library(name: str) -> Any:
    try:
        return import_module(name)
    except ImportError:
        raise missing_extra("tables and datasets", name, "tables") from None
