"""What may happen to a file: bits flip, parts are lost, doubled or moved, numbers and words are replaced."""

from __future__ import annotations

import re

import numpy as np

WORDS = (
    *(b"nan", b"-inf", b"1e999", b"9" * 400, b"-1", b"0", b"1e8", b"4294967295", b"0x10", b"null", b"true", b"[]"),
    *(b"\x00", b"\xff\xfe", b"\x1b[31m", b"[" * 5000, b"{" * 5000, b'"', b"'''", b"\n", b"../../x", b"\xe2\x80\xae"),
)
NUMBER = re.compile(rb"[-+]?\d+(?:\.\d*)?(?:[eE][-+]?\d+)?")
NAME = re.compile(rb"[A-Za-z_]{2,}")


def mutated(content: bytes, rng: np.random.Generator) -> bytes:
    """The content after one accident, sometimes two."""
    for _ in range(1 + int(rng.random() < 0.2)):
        content = ACCIDENTS[int(rng.integers(len(ACCIDENTS)))](content, rng)
    return content


def _place(content: bytes, rng: np.random.Generator) -> int:
    """Any place, often in the first bytes, where headers are."""
    return int(rng.integers(max(1, min(len(content), 400 if rng.random() < 0.3 else len(content)))))


def _slice(content: bytes, rng: np.random.Generator) -> tuple[int, int]:
    start = _place(content, rng)
    return start, start + int(rng.integers(1, 2 + min(len(content), 10 ** int(rng.integers(1, 5)))))


def flip_bit(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + bytes(b ^ 1 << int(rng.integers(8)) for b in content[at : at + 1]) + content[at + 1 :]


def set_bytes(content: bytes, rng: np.random.Generator) -> bytes:
    at, value = _place(content, rng), (0x00, 0xFF, 0x7F, 0x80)[int(rng.integers(4))]
    count = int(rng.integers(1, 9))
    return content[:at] + bytes([value]) * count + content[at + count :]


def cut_end(content: bytes, rng: np.random.Generator) -> bytes:
    return content[: _place(content, rng)]


def lose_slice(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _slice(content, rng)
    return content[:start] + content[end:]


def double_slice(content: bytes, rng: np.random.Generator) -> bytes:
    start, end = _slice(content, rng)
    return content[:end] + content[start:end] + content[end:]


def insert_word(content: bytes, rng: np.random.Generator) -> bytes:
    at = _place(content, rng)
    return content[:at] + WORDS[int(rng.integers(len(WORDS)))] + content[at:]


def replace_token(content: bytes, rng: np.random.Generator) -> bytes:
    """Another word in place of a number or a name."""
    pattern = NUMBER if rng.random() < 0.6 else NAME
    found = [match.span() for match in pattern.finditer(content)]
    if not found:
        return insert_word(content, rng)
    start, end = found[int(rng.integers(len(found)))]
    return content[:start] + WORDS[int(rng.integers(len(WORDS)))] + content[end:]


def swap_lines(content: bytes, rng: np.random.Generator) -> bytes:
    lines = content.split(b"\n")
    a, b = (int(rng.integers(len(lines))) for _ in range(2))
    lines[a], lines[b] = lines[b], lines[a]
    return b"\n".join(lines)


ACCIDENTS = (
    *(flip_bit, set_bytes, cut_end, lose_slice, double_slice),
    *(insert_word, replace_token, replace_token, swap_lines),
)
