"""Files that are never half written, and never trusted before they are checked."""

from casadi_contact.files.digest import sha256_of
from casadi_contact.files.existing import existing_file
from casadi_contact.files.folder_lock import folder_lock
from casadi_contact.files.hdf5 import new_hdf5, open_hdf5
from casadi_contact.files.limits import MOST_MESH, MOST_TEXT, MOST_UNPACKED, checked_size, one_line, short
from casadi_contact.files.names import file_stem
from casadi_contact.files.npz import read_npz, write_npz
from casadi_contact.files.numbers import finite_number
from casadi_contact.files.replacing import replacing, scratch_folder, writable_folder, write_bytes, write_text

__all__ = [
    "MOST_MESH",
    "MOST_TEXT",
    "MOST_UNPACKED",
    "checked_size",
    "existing_file",
    "file_stem",
    "finite_number",
    "folder_lock",
    "new_hdf5",
    "one_line",
    "open_hdf5",
    "read_npz",
    "replacing",
    "scratch_folder",
    "sha256_of",
    "short",
    "writable_folder",
    "write_bytes",
    "write_npz",
    "write_text",
]
