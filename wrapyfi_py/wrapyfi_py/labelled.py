"""Values with names to them: arrays of xarray, quantities of pint."""

import re

import numpy as np

from .arrays import is_tensor
from .values import Absent, MessageError, library, mapping, member

#: Characters of units: pint takes long for a long name.
MAX_UNITS = 200

#: A unit as pint writes it: ``kilogram * meter / second ** 2``. Nothing else goes to pint, which would compute
#: any expression, however large.
_UNIT = r"(?:[^\W\d]\w*|1)(?: ?\*\* ?-?\d{1,3}(?:\.\d{1,6})?)?"
_UNITS = re.compile(rf"{_UNIT}(?: ?[*/] ?{_UNIT}){{0,31}}")


def read(body, _reader):
    """The ``DataArray`` or ``Dataset`` of xarray."""
    body = mapping(body, "labelled array")
    coords = _variables(body, "coords")
    if "array" in body:
        dims, data, attrs = _variable(body["array"], "array")
        name = body.get("name")
        if name is not None and not isinstance(name, str):
            raise MessageError("the name of a labelled array is no text")
        return library("xarray").DataArray(data, coords=coords, dims=dims, name=name, attrs=attrs)
    variables, attrs = _variables(body, "variables"), member(body, "attrs", dict, "data set")
    return library("xarray").Dataset(variables, coords=coords, attrs=attrs)


def _variables(body, key):
    return {
        name: _variable(variable, f"{key} {name[:40]!r}")
        for name, variable in member(body, key, dict, "labelled array").items()
    }


def _variable(body, what):
    body = mapping(body, what)
    dims, attrs = member(body, "dims", list, what), member(body, "attrs", dict, what)
    if not all(isinstance(dim, str) for dim in dims):
        raise MessageError(f"dims of {what} hold something that is no text")
    if "data" not in body:
        raise MessageError(f"data of {what} is missing")
    data = body["data"]
    return dims, np.array(data) if isinstance(data, list) else data, attrs


def write(value):
    """Tag and body of an array or data set of xarray; ``None`` for anything else."""
    import xarray

    if isinstance(value, xarray.DataArray):
        if value.name is not None and not isinstance(value.name, str):
            raise MessageError(f"a DataArray whose name is of type {type(value.name).__name__}: use text")
        content = {"name": value.name, "array": _write_variable(value.variable, value.name)}
    elif isinstance(value, xarray.Dataset):
        content = {
            "dims": {str(name): extent for name, extent in value.sizes.items()},
            "variables": _write_variables(value.data_vars),
            "attrs": dict(value.attrs),
        }
    else:
        return None
    for name, index in value.indexes.items():
        if index.nlevels > 1:
            raise MessageError(f"coordinate {name!r} of several levels: use reset_index")
    return "labelled", content | {"coords": _write_variables(value.coords)}


def _write_variables(named):
    return {_text(name): _write_variable(array.variable, name) for name, array in named.items()}


def _write_variable(variable, name):
    return {
        "dims": [_text(dim) for dim in variable.dims],
        "attrs": dict(variable.attrs),
        "data": _write_data(np.asarray(variable.values), name),
    }


def _write_data(data, name):
    if data.dtype.kind == "M":
        # Python's datetime where it has as many digits, which more readers know.
        exact = data.astype("M8[us]")
        found = exact if (exact == data).all() else data
        return found.tolist() if found is exact else _each(found)
    if is_tensor(data):
        return data.item() if data.ndim == 0 and data.dtype.kind != "c" and data.itemsize == 8 else data
    if data.dtype.kind in "UO":
        return data.tolist()
    raise MessageError(f"{data.dtype} data of {name!r} in an array of xarray: use numbers, text or times")


def _each(data):
    return data[()] if data.ndim == 0 else [_each(part) for part in data]


def _text(name):
    if isinstance(name, str):
        return name
    raise MessageError(f"a dimension or coordinate whose name is of type {type(name).__name__}: use text")


def read_quantity(body, _reader):
    """The quantity of pint, in the application's registry."""
    body = mapping(body, "quantity")
    magnitude, units = member(body, "magnitude", (int, float), "quantity"), member(body, "units", str, "quantity")
    pint = library("pint")
    if len(units) > MAX_UNITS or not _UNITS.fullmatch(units):
        raise Absent(f"{units[:80]!r} is no product of units as pint writes it")
    try:
        return pint.get_application_registry().Quantity(magnitude, units)
    except Exception as problem:  # an unknown unit, and whatever else a registry raises
        raise Absent(f"pint does not take {units[:80]!r}: {problem}") from None


def write_quantity(value):
    """Tag and body of a quantity of pint; ``None`` for anything else."""
    import pint

    if not isinstance(value, pint.Quantity):
        return None
    magnitude = value.magnitude.item() if isinstance(value.magnitude, np.generic) else value.magnitude
    if isinstance(magnitude, bool) or not isinstance(magnitude, (int, float)):
        raise MessageError(
            f"a quantity whose magnitude is of type {type(magnitude).__name__}: send magnitude and units"
        )
    return "quantity", {"magnitude": magnitude, "units": str(value.units)}
