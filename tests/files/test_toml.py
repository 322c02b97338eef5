"""TOML that anyone may have written is read, or refused in one line before it takes long."""

import pytest

from casadi_contact.files.toml import toml_tables

PARTS = ["a", '"a b"', "'a.b'", r'"a\"b"']


@pytest.mark.parametrize("part", PARTS)
@pytest.mark.parametrize("line", ["{key} = 1", "[{key}]", "x = {{ {key} = 1 }}"])
@pytest.mark.parametrize("dot", [".", " . "])
def test_a_key_of_ever_so_many_parts_is_refused(part, line, dot):
    text = line.format(key=dot.join([part] * 200))
    with pytest.raises(ValueError, match=r"^scene: .*nested too deep, expected a few levels$"):
        toml_tables(text, "scene")


@pytest.mark.parametrize("part", PARTS)
def test_a_key_of_a_few_parts_and_long_words_lists_and_strings_are_read(part):
    word = "a" * 200_000
    text = f"{'.'.join([part] * 9)} = 1\n{word} = [{'0.5, ' * 1000}]\ny = '{word} ...'\nz = \"{'. ' * 1000}\""
    tables = toml_tables(text, "scene")
    assert tables[word] == [0.5] * 1000
    assert tables["y"] == f"{word} ..."
