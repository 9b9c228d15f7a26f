"""Tables as text."""

from plenoptic.study.text_table import comma_separated, markdown_table, plain_table


def test_columns_are_padded_to_equal_widths():
    assert plain_table(("a", "bc"), [("10", "2")]) == "a   bc\n10  2"
    assert markdown_table(("a", "b"), [("10", "x|y")]).splitlines() == [
        "| a  | b    |",
        "| -- | ---- |",
        r"| 10 | x\|y |",
    ]


def test_commas_are_quoted_and_none_is_nothing():
    rows = comma_separated([("name", "s"), ("a, b", None), ("c", 0.1)], None).splitlines()
    assert rows == ["name,s", '"a, b",', "c,0.1"]
