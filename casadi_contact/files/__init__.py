"""Files: read with bounded sizes and errors of one line, written atomically."""

from casadi_contact.files.containers import new_hdf5, open_hdf5, read_npz, sealed, write_npz
from casadi_contact.files.reading import (
    MOST_MESH,
    MOST_TEXT,
    MOST_UNPACKED,
    checked_size,
    existing_file,
    finite_number,
    one_line,
    sha256_of,
    short,
    toml_tables,
    toml_text,
)
from casadi_contact.files.writing import folder_lock, replacing, writable_folder, write_bytes, write_text

__all__ = [
    "MOST_MESH",
    "MOST_TEXT",
    "MOST_UNPACKED",
    "checked_size",
    "existing_file",
    "finite_number",
    "folder_lock",
    "new_hdf5",
    "one_line",
    "open_hdf5",
    "read_npz",
    "replacing",
    "sealed",
    "sha256_of",
    "short",
    "toml_tables",
    "toml_text",
    "writable_folder",
    "write_bytes",
    "write_npz",
    "write_text",
]
