"""The table of a kernel: where its arrays lie and how far their rows are apart, so that nothing is copied or spread."""

from typing import Any

import numpy as np

from auv_torchrl.physics.kernel.assembly import COUNTS, LANES, WORDS, array_names
from auv_torchrl.physics.kernel.native import Code
from auv_torchrl.physics.kernel.program import Layout
from auv_torchrl.quantities import counted

Array = np.ndarray[Any, np.dtype[Any]]

NEW_VEHICLE = 1.5  # steps that reading the coefficients of other vehicles takes


class Memory:
    """What a kernel works out of the constants of rows (R,), kept from call to call of one window; empty at first."""

    def __init__(self, rows: int, numbers: int, dtype: Any):
        """Room for so many numbers of each row, in a precision."""
        size = np.dtype(dtype).itemsize
        lanes = LANES[8 * size]
        vector = lanes * size  # bytes, on multiples of which LLVM reads vectors
        self._room = np.empty(-(-rows // lanes) * numbers * vector + vector, np.uint8)
        self.address = -(-self._room.ctypes.data // vector) * vector
        self.filled = False


def readable(array: Any, dtype: Any) -> Array:
    """The same numbers in a precision, those of a row side by side."""
    array = np.asarray(array, dtype=dtype)
    return array if array.strides[-1] == array.itemsize else np.ascontiguousarray(array)


def table(
    layout: Layout, arrays: dict[str, Array], shape: tuple[int, int, int, int], memory: Memory | None = None
) -> Array:
    """The words of a call.

    Args:
        layout: of the kernel.
        arrays: by name, as :func:`~auv_torchrl.physics.kernel.assembly.array_names` lists them; axes windows, rows,
            steps, parts and numbers, those left out at the end but for the numbers. One in an axis stands for all.
        shape: windows, rows, steps and parts of the call, all at least 1.
        memory: of these rows, for calls of one window; None to read the constants anew.

    Raises:
        ValueError: for an array that does not have these axes; compiled code would read beside it.
    """
    numbers = {"constants": sum(layout.constants.values()), **layout.carried, **layout.given, **layout.written}
    strides = {}
    for name, array in arrays.items():
        wanted = (*shape[: array.ndim - 1], numbers[name.removeprefix("final ")])
        if array.shape[-1] != wanted[-1] or any(
            size not in (1, axis) for size, axis in zip(array.shape, wanted, strict=True)
        ):
            raise ValueError(f"{name} must have the shape {wanted}, or 1 in place of an axis, and has {array.shape}")
        if array.shape[-1] > 1 and array.strides[-1] != array.itemsize:
            raise ValueError(
                f"{name} has its numbers {counted(array.strides[-1], 'byte')} apart: give them side by side"
            )
        strides[name] = _strides(array)
    lanes = LANES[8 * arrays["constants"].itemsize]
    windows_first = _windows_are_lanes(shape, strides["constants"], lanes)
    windows, rows, steps, parts = shape
    words = [rows, windows, steps, parts] if windows_first else [windows, rows, steps, parts]
    words += [0, 0] if memory is None else [memory.address, int(memory.filled)]
    for name in array_names(layout):
        window, row, step, part = strides[name]
        words += [arrays[name].ctypes.data, *((row, window) if windows_first else (window, row)), step, part]
    return np.array(words, dtype=np.int64)


def _strides(array: Array) -> list[int]:
    """Bytes between windows, rows, steps and parts: none where there is but one."""
    known = [0 if size == 1 else stride for size, stride in zip(array.shape[:-1], array.strides[:-1], strict=True)]
    return known + [0] * (4 - len(known))


def _windows_are_lanes(shape: tuple[int, int, int, int], constants: list[int], lanes: int) -> bool:
    """Whether vectors hold several windows of one vehicle; several vehicles of one window otherwise."""
    windows, rows, steps, parts = shape
    vectors = [rows * -(-windows // lanes), windows * -(-rows // lanes)]
    if constants[1]:
        work = [vectors[0] * steps * parts + NEW_VEHICLE * rows, vectors[1] * (steps * parts + NEW_VEHICLE)]
    else:
        work = [vectors[0] * steps * parts, vectors[1] * steps * parts]
    return work[0] <= work[1]


class Call:
    """Calls of code that differ in nothing but where some of their arrays lie.

    Args:
        code: what is called.
        layout, arrays, shape, memory: of :func:`table`; arrays that :meth:`run` is not given stay where they are.
    """

    def __init__(
        self,
        code: Code,
        layout: Layout,
        arrays: dict[str, Array],
        shape: tuple[int, int, int, int],
        memory: Memory | None = None,
    ):
        self._code, self._arrays, self._memory = code, arrays, memory
        self._words = table(layout, arrays, shape, memory)
        self._places = {name: COUNTS + WORDS * place for place, name in enumerate(array_names(layout))}

    def run(self, given: dict[str, Array]) -> None:
        """Call, with these arrays in place of those of the same shape, precision and order.

        Raises:
            ValueError: for an array of another shape, precision or order; compiled code would read beside it.
        """
        for name, array in given.items():
            known = self._arrays[name]
            if array.size != known.size or array.dtype != known.dtype or not array.flags.c_contiguous:
                raise ValueError(
                    f"{name} must be {counted(known.size, 'number')} in one piece, {known.dtype}, and is {array.shape}"
                )
            self._words[self._places[name]] = array.ctypes.data
        self._code(self._words.ctypes.data)
