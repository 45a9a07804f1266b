"""How results look in a notebook: small tables in HTML, which follow the reader's light or dark scheme."""

from collections.abc import Iterable, Sequence
from html import escape


def html_table(
    caption: str, headings: Sequence[str], rows: Iterable[Sequence[object]], notes: Sequence[str] = ()
) -> str:
    """A table with a caption above it and notes below it; all text is escaped.

    Args:
        caption: one line.
        headings: of the columns.
        rows: cells, written by `str`; numbers as the caller rounds them. NaN is an empty cell.
        notes: sentences.
    """
    head = "".join(f"<th>{escape(text)}</th>" for text in headings)
    cells = ((("" if str(cell) == "nan" else escape(str(cell))) for cell in row) for row in rows)
    body = "".join(f"<tr>{''.join(f'<td>{cell}</td>' for cell in row)}</tr>" for row in cells)
    below = "".join(f"<p>{escape(note)}</p>" for note in notes)
    return f"<p><b>{escape(caption)}</b></p><table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>{below}"
