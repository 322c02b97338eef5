"""Copy an HDF5 file that nobody has checked, as a program of its own: HDF5 may spin or crash on damaged bytes.

``python hdf5_copy.py FILE CPU_SECONDS`` writes the image of a clean copy to standard output. It imports nothing of
this package, so that it starts fast.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator
from contextlib import suppress

import h5py
import numpy as np

REFUSED = 3  # exit status: refused with a reason
MOST_OBJECTS = 10_000
MOST_UNPACKED = 1 << 30  # bytes of compressed data sets together
_MOST_MEMORY = 16 << 30
_COPIES, _LEAST_MEMORY = 8, 256 << 20  # a text takes up to eight times its bytes as an object of Python
_PACKED_RATIO = 1032  # what deflate, the strongest of HDF5's filters, can pack into a byte
_CHECKSUM = h5py.h5z.FILTER_FLETCHER32


class RefusedError(Exception):
    """HDF5 that can be read, but must not be."""


def check(file: h5py.File, size: int) -> int:
    """Refuse what reaches outside the file, and more than its `size` bytes can hold; raises RefusedError.

    Returns the bytes of all data sets, without those of texts of any length, which lie elsewhere in the file.
    """
    plain = packed = 0
    for name, item in _items(file):
        if not isinstance(item, h5py.Dataset):
            continue
        storage = item.id.get_create_plist()
        if storage.get_external_count() or item.is_virtual:
            raise RefusedError(f"data set {name} lies in another file, expected all data in this one")
        filters = [storage.get_filter(k)[0] for k in range(storage.get_nfilters())]
        count = item.nbytes if item.shape is not None else 0
        if all(code == _CHECKSUM for code in filters):
            plain += count
        else:
            packed += count
        if plain > size or packed > min(MOST_UNPACKED, _PACKED_RATIO * size):
            raise RefusedError(
                f"data set {name} claims {count} bytes in a file of {size}, expected no more than the file holds "
                f"({MOST_UNPACKED} bytes where compressed)"
            )
    return plain + packed


def _items(group: h5py.Group) -> Iterator[tuple[str, h5py.Group | h5py.Dataset]]:
    """All groups and data sets below a group, each once; only hard links are followed."""
    waiting, seen = [group], {h5py.h5o.get_info(group.id).addr}
    while waiting:
        parent = waiting.pop()
        for key in parent:
            name = f"{parent.name.rstrip('/')}/{key}"
            if not isinstance(parent.get(key, getlink=True), h5py.HardLink):
                raise RefusedError(f"{name} is a link to elsewhere, expected data in this file")
            item = parent[key]
            if isinstance(item, h5py.Datatype):
                continue
            address = h5py.h5o.get_info(item.id).addr
            if address in seen or len(seen) > MOST_OBJECTS:
                raise RefusedError(f"{name} is one object too many or there twice")
            seen.add(address)
            yield name, item
            if isinstance(item, h5py.Group):
                waiting.append(item)


def _is_plain(dtype: np.dtype) -> bool:
    """Numbers or text; references and records are of no use to this library."""
    return dtype.kind in "biufS" or h5py.check_string_dtype(dtype) is not None


def image_of_copy(path: str) -> bytes:
    """The groups, data sets and attributes of an HDF5 file, as far as they are numbers or text, as a new file."""
    with (
        open(path, "rb") as stream,
        h5py.File(path, "r") as file,
        h5py.File("copy", "w", driver="core", backing_store=False) as copy,
    ):
        size = stream.seek(0, 2)
        _limit_memory(size + check(file, size))
        for name, item in [("/", file), *_items(file)]:
            if isinstance(item, h5py.Group):
                made = copy.require_group(name) if name == "/" else copy.create_group(name, track_order=True)
            elif _is_plain(item.dtype) and item.shape is not None:
                made = copy.create_dataset(name, data=item[()], dtype=item.dtype, track_times=False)
            else:
                continue
            made.attrs.update({key: item.attrs[key] for key in item.attrs if _is_plain(item.attrs.get_id(key).dtype)})
        copy.flush()
        return copy.id.get_file_image()


def _limit(cpu_s: int) -> None:
    try:
        import resource
    except ImportError:  # no such limits on this system
        return
    limits = {resource.RLIMIT_CPU: cpu_s, resource.RLIMIT_AS: _MOST_MEMORY, resource.RLIMIT_CORE: 0}
    for kind, limit in limits.items():
        with suppress(ValueError, OSError):  # a lower limit is set already, or the system knows none of this kind
            resource.setrlimit(kind, (limit, limit))


def _limit_memory(content: int) -> None:
    """Let the copy take a few times the bytes of its content: a million texts may claim the same place in the file."""
    with suppress(ImportError, ValueError, OSError):  # no such limit on this system, or a lower one is set
        import resource

        with open("/proc/self/statm", encoding="ascii") as file:
            taken = int(file.read().split()[0]) * resource.getpagesize()
        limit = min(taken + _COPIES * content + _LEAST_MEMORY, _MOST_MEMORY)
        resource.setrlimit(resource.RLIMIT_AS, (limit, limit))


if __name__ == "__main__":
    _limit(int(sys.argv[2]))
    try:
        copied = image_of_copy(sys.argv[1])
    except RefusedError as error:
        print(f"refused: {error}", file=sys.stderr)
        sys.exit(REFUSED)
    except Exception as error:  # h5py raises many kinds for damaged bytes
        kind = "damaged" if h5py.is_hdf5(sys.argv[1]) else "damaged or not an HDF5 file"
        print(f"{kind} ({' '.join(str(error).split()) or type(error).__name__})", file=sys.stderr)
        sys.exit(REFUSED)
    sys.stdout.buffer.write(copied)
