"""Whether a MATLAB 5 file holds what its tags say.

SciPy's reader takes the type codes and lengths in a file on trust, and a damaged one can end the
whole process (SciPy 1.17: a type code out of range reads outside its table). So the tags are
followed here first: MathWorks, MAT-File Format, 2019, chapter 1.
"""

import struct
import zlib

from flexstage.records.datasets import most_unpacked, require_unpacked

_MATRIX, _COMPRESSED = 14, 15
_SIZES = {1: 1, 2: 1, 3: 2, 4: 2, 5: 4, 6: 4, 7: 4, 9: 8, 12: 8, 13: 8}
_NAMES = (1, 2, 16)
_TEXT_TYPES = frozenset((1, 2, 3, 4, 16, 17, 18))
_CELL, _STRUCT, _OBJECT, _CHAR, _SPARSE, _FUNCTION, _OPAQUE = 1, 2, 3, 4, 5, 16, 17
_NUMERIC = range(6, 16)
_MOST_ENTRIES = 2**32
_DEEPEST = 40


def require_sound(data: bytes) -> None:
    """Refuse a MATLAB 5 file whose tags contradict each other.

    A ValueError says what is cut short or damaged.
    """
    order = {b"IM": "<", b"MI": ">"}.get(data[126:128])
    if order is None:
        raise ValueError("its heading is damaged")
    position, unpacked, most = 128, 0, most_unpacked(len(data))
    while position + 8 <= len(data):
        kind, size = struct.unpack_from(f"{order}II", data, position)
        start, position = position + 8, position + 8 + size
        if position > len(data):
            raise ValueError("it is cut short")
        if kind == _COMPRESSED:
            inner = _inflated(data[start:position], most - unpacked)
            unpacked += len(inner)
            require_unpacked(unpacked, len(data), "the whole of its variables")
            walk = _Walk(inner, order)
            kind, start, end, _ = walk.tag(0, len(inner))
            if kind != _MATRIX:
                raise ValueError("a compressed variable is damaged")
            walk.matrix(start, end, 0)
        elif kind == _MATRIX:
            _Walk(data, order).matrix(start, position, 0)
        else:
            raise ValueError(f"a variable of the unknown type {kind}")


def _inflated(packed: bytes, most: int) -> bytes:
    """Unpack a variable, and no more than a byte beyond what it may have."""
    try:
        inner = zlib.decompressobj().decompress(packed, most + 1)
    except zlib.error as error:
        raise ValueError("a compressed variable is damaged") from error
    return inner


class _Walk:
    """Follows the tags of one variable."""

    def __init__(self, data: bytes, order: str) -> None:
        self.data = data
        self.order = order

    def tag(self, at: int, end: int) -> tuple[int, int, int, int]:
        """Return type, first byte and end of an element, and where the next one begins."""
        if at + 8 > end:
            raise ValueError("a variable is cut short")
        kind, size = struct.unpack_from(f"{self.order}II", self.data, at)
        if kind >> 16:
            # up to four bytes stand in the tag itself
            kind, size, start = kind & 0xFFFF, kind >> 16, at + 4
            following = at + 8
            if size > 4:
                raise ValueError("a short element is damaged")
        else:
            start = at + 8
            following = start + size + (-size) % 8
        if start + size > end:
            raise ValueError("an element is longer than its variable")
        return kind, start, start + size, following

    def element(self, at: int, end: int, kinds: object) -> tuple[int, int, int, int]:
        """Return an element, which must be of a given type."""
        found = self.tag(at, end)
        if found[0] not in kinds:  # type: ignore[operator]
            raise ValueError(f"an element of the unexpected type {found[0]}")
        return found

    def matrix(self, at: int, end: int, depth: int) -> None:
        """Follow a matrix of numbers, texts or other matrices."""
        if at == end:
            return
        if depth > _DEEPEST:
            raise ValueError("structures are nested too deep")
        _, start, stop, at = self.element(at, end, (6,))
        if stop - start != 8:
            raise ValueError("the flags of a variable are damaged")
        (flags,) = struct.unpack_from(f"{self.order}I", self.data, start)
        kind, is_complex = flags & 0xFF, bool(flags & 0x800)
        if kind == _OPAQUE:
            self._opaque(at, end, depth)
            return
        _, start, stop, at = self.element(at, end, (5, 6))
        if (stop - start) % 4 or stop - start < 8:
            raise ValueError("the dimensions of a variable are damaged")
        shape = struct.unpack_from(f"{self.order}{(stop - start) // 4}i", self.data, start)
        count = 1
        for n in shape:
            count *= n
            if n < 0 or count > _MOST_ENTRIES:
                raise ValueError("the dimensions of a variable are damaged")
        *_, at = self.element(at, end, _NAMES)
        if kind in _NUMERIC:
            self._numbers(at, end, count, 2 if is_complex else 1)
        elif kind == _CHAR:
            self.element(at, end, _TEXT_TYPES)
        elif kind == _CELL:
            self._items(at, end, count, depth)
        elif kind in (_STRUCT, _OBJECT):
            self._structure(at, end, count, depth, named=kind == _OBJECT)
        elif kind == _SPARSE:
            *_, at = self.element(at, end, (5, 6))
            *_, at = self.element(at, end, (5, 6))
            self.element(at, end, _SIZES)
        elif kind == _FUNCTION:
            self._items(at, end, 1, depth)
        else:
            raise ValueError(f"a variable of the unknown class {kind}")

    def _numbers(self, at: int, end: int, count: int, parts: int) -> None:
        for _ in range(parts):
            kind, start, stop, at = self.element(at, end, _SIZES)
            if stop - start != count * _SIZES[kind]:
                raise ValueError("a variable has not as many numbers as it says")

    def _items(self, at: int, end: int, count: int, depth: int) -> None:
        for _ in range(count):
            _, start, stop, at = self.element(at, end, (_MATRIX,))
            self.matrix(start, stop, depth + 1)

    def _structure(self, at: int, end: int, count: int, depth: int, *, named: bool) -> None:
        if named:
            *_, at = self.element(at, end, _NAMES)
        _, start, stop, at = self.element(at, end, (5, 6))
        width = struct.unpack_from(f"{self.order}i", self.data, start)[0] if stop > start else 0
        _, start, stop, at = self.element(at, end, _NAMES)
        if width < 1 or (stop - start) % width:
            raise ValueError("the names of a structure are damaged")
        self._items(at, end, count * ((stop - start) // width), depth)

    def _opaque(self, at: int, end: int, depth: int) -> None:
        while at < end:
            kind, start, stop, at = self.element(at, end, {*_TEXT_TYPES, *_SIZES, _MATRIX})
            if kind == _MATRIX:
                self.matrix(start, stop, depth + 1)
