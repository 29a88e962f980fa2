"""The batch's arrays on the device, or of numpy where kernels are simulated."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from graindamp.dem.gpu.device import simulated
from graindamp.dem.gpu.load import Loaded
from graindamp.dem.gpu.state import PARTS, Batch, Room, bytes_of, layout


class Memory:
    """Arrays of one batch, with room for a number of slots."""

    def __init__(self, room: Room, real: type) -> None:
        """Arrays of the given room, their content undefined but for the slots' stages.

        Raises:
            MemoryError: the device has no room for them.
        """
        self.room, self.real = room, real
        self.layout = layout(room, real)
        self.batch = self._made(lambda part, name: None)
        self.whole("slots", "counts", np.zeros(self.layout["slots"]["counts"][0], np.int64))

    def _made(self, old: Callable[[str, str], NDArray[Any] | None]) -> Batch:
        parts = {}
        for part, names in self.layout.items():
            arrays = {}
            for name, (shape, kind) in names.items():
                arrays[name] = _empty(shape, kind)
                content = old(part, name)
                if content is not None:
                    host: NDArray[Any] = np.zeros(shape, kind)
                    host[tuple(slice(0, size) for size in content.shape)] = content
                    _put(arrays[name], host)
            parts[part] = PARTS[part](**arrays)
        return Batch(**parts)

    def array(self, part: str, name: str) -> Any:
        """One of the arrays."""
        return getattr(getattr(self.batch, part), name)

    def whole(self, part: str, name: str, value: NDArray[Any]) -> None:
        """Write one array."""
        _put(self.array(part, name), value)

    def read(self, part: str, name: str, slot: int | None = None) -> NDArray[Any]:
        """One array, or one slot of it, on the host."""
        array = self.array(part, name)
        if slot is not None:
            array = array[slot]
        return np.array(array) if simulated() else array.copy_to_host()

    def write(self, part: str, name: str, slot: int, value: NDArray[Any]) -> None:
        """Write one slot of an array; padding is zero."""
        shape, kind = self.layout[part][name]
        host: NDArray[Any] = np.zeros(shape[1:], kind)
        host[tuple(slice(0, size) for size in np.shape(value))] = value
        array = self.array(part, name)
        if len(shape) == 1:
            _put(array[slot : slot + 1], host.reshape(1))
        else:
            _put(array[slot], host)

    def load(self, slot: int, world: Loaded) -> None:
        """Put a world into a slot."""
        for part, arrays in world.arrays.items():
            for name, value in arrays.items():
                self.write(part, name, slot, value)

    def enlarged(self, room: Room) -> "Memory":
        """The same worlds in larger arrays.

        Raises:
            MemoryError: the device has no room for them.
        """
        new = object.__new__(Memory)
        new.room, new.real, new.layout = room, self.real, layout(room, self.real)
        new.batch = new._made(lambda part, name: self.read(part, name))
        return new

    @property
    def bytes(self) -> int:
        """Memory that the arrays take [bytes]."""
        return bytes_of(self.room, self.real)


def covering(one: Room, other: Room) -> Room:
    """The least room that covers both."""
    larger: Any = [max(a, b) for a, b in zip(one, other, strict=True)]
    return Room(*larger)


def _empty(shape: tuple[int, ...], kind: type) -> Any:
    if simulated():
        return np.empty(shape, kind)
    from numba import cuda

    try:
        return cuda.device_array(shape, kind)
    except Exception as error:
        if "OUT_OF_MEMORY" in str(error).upper():
            raise MemoryError(f"the GPU has no room for an array of {shape}") from None
        raise


def _put(array: Any, value: NDArray[Any]) -> None:
    if simulated():
        array[...] = value
    else:
        array.copy_to_device(np.ascontiguousarray(value))
