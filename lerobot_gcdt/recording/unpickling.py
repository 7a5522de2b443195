"""Reading ``.npz`` archives with pickled objects, such as SurRoL's, without running anything that they say.

A pickle is a program that calls what it names. Even NumPy's own functions are too much to offer: the pickled state of a
data type can declare bytes to be pointers. So the few names that arrays and numbers need are answered by what is below,
which makes them from bytes of the right length, and every other name is refused.
"""

import math
import pickle
import zipfile
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from numpy.lib import format as npy

ADMITTED = "arrays, dictionaries, lists, tuples, strings and numbers"


def read_archive(file: str | Path) -> dict[str, np.ndarray]:
    """Reads an ``.npz`` archive whose arrays hold nothing but what is ``ADMITTED``.

    Args:
        file: The archive.

    Returns:
        Its arrays, by name.

    Raises:
        ValueError: It is no such archive, is damaged, or holds anything else; nothing of it was executed.
        OSError: It cannot be opened.
    """
    try:
        with zipfile.ZipFile(file) as archive:
            members = {name.removesuffix(".npy"): archive.read(name) for name in archive.namelist()}
    except zipfile.BadZipFile as error:
        raise ValueError(f"{file} is no .npz archive: {error}.") from error
    arrays = {}
    for name, content in members.items():
        try:
            arrays[name] = _read_array(BytesIO(content))
        except Exception as error:  # there is no end to the ways in which a pickle can be wrong
            raise ValueError(
                f"{file} is refused: {name} {error}. Only {ADMITTED} are read; nothing was executed."
            ) from error
    return arrays


def _read_array(stream: BytesIO) -> np.ndarray:
    header = npy.read_array_header_1_0 if npy.read_magic(stream) == (1, 0) else npy.read_array_header_2_0
    if not header(stream)[2].hasobject:
        stream.seek(0)
        return npy.read_array(stream, allow_pickle=False)
    array = _Unpickler(stream).load()
    if not isinstance(array, np.ndarray):
        raise pickle.UnpicklingError(f"holds a {type(array).__name__} instead of an array")
    return array


class _Unpickler(pickle.Unpickler):
    def find_class(self, module: str, name: str) -> Any:
        """Answers the names that pickled arrays and numbers hold."""
        if module in ("numpy", "numpy.core.multiarray", "numpy._core.multiarray") and name in _ANSWERS:
            return _ANSWERS[name]
        raise pickle.UnpicklingError(f"holds {module}.{name}")


class _DataType:
    """A data type by its name and byte order. What else its pickled state says is not looked at."""

    def __init__(self, name: str, *_: Any):
        self.dtype = np.dtype(str(name))
        if self.dtype.kind not in "biufUSO":
            raise pickle.UnpicklingError(f"holds an array of the type {name}")

    def __setstate__(self, state: tuple) -> None:
        self.dtype = self.dtype.newbyteorder(state[1])


class _Array(np.ndarray):
    """An array that looks at its pickled state before NumPy does."""

    def __setstate__(self, state: tuple) -> None:
        _, shape, data_type, fortran_order, content = state
        dtype, numbers = data_type.dtype, math.prod(shape)
        kind, size = (list, numbers) if dtype.hasobject else (bytes, numbers * dtype.itemsize)
        if type(content) is not kind or len(content) != size or min(shape, default=0) < 0:
            raise pickle.UnpicklingError(f"holds an array whose content does not fit its shape {shape}")
        super().__setstate__((1, shape, dtype, fortran_order, content))


def _empty(*_: Any) -> _Array:
    return np.ndarray.__new__(_Array, 0)


def _number(data_type: _DataType, content: bytes) -> np.generic:
    return np.frombuffer(content, data_type.dtype)[0]


_ANSWERS = {"ndarray": None, "dtype": _DataType, "_reconstruct": _empty, "scalar": _number}
