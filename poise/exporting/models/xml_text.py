"""Changes of an XML file that leave every other byte as it is: comments, order, indents and quotes stay."""

import re
from collections.abc import Iterator
from dataclasses import dataclass, field
from xml.parsers import expat
from xml.sax.saxutils import quoteattr

from poise.errors import ErrorCode, InputError

_MAX_BYTES = 50_000_000
_ATTRIBUTE = re.compile(rb"([^\s=<>/]+)\s*=\s*(?:\"[^\"]*\"|'[^']*')")


@dataclass(eq=False)
class XmlElement:
    """An element of the file.

    Args:
        name: tag. attributes: as parsed. parent: None: the root.
        start, inside, stop, end: bytes at which its start tag begins, its content begins and ends, and it ends.
    """

    name: str
    attributes: dict[str, str]
    parent: "XmlElement | None"
    start: int
    inside: int = 0
    stop: int = 0
    end: int = 0
    children: list["XmlElement"] = field(default_factory=list)

    def child(self, name: str) -> "XmlElement | None":
        """The first child of a name."""
        return next((each for each in self.children if each.name == name), None)

    def walk(self) -> Iterator["XmlElement"]:
        """It and all below it."""
        yield self
        for each in self.children:
            yield from each.walk()


class XmlText:
    """An XML file and changes of it.

    Args:
        source: the file.
        root: name of the root element that it must have.

    Raises:
        InputError: BAD_INPUT for no XML, entities (they can grow without bound), UTF-16, or another root.
    """

    def __init__(self, source: bytes, root: str) -> None:
        self._source = source
        self._edits: list[tuple[int, int, bytes]] = []
        self._tags: dict[int, bytes] = {}
        if len(source) > _MAX_BYTES:
            raise InputError(ErrorCode.BAD_INPUT, f"the model has more than {_MAX_BYTES} bytes")
        if b"\0" in source:
            raise InputError(ErrorCode.BAD_INPUT, "the model is not UTF-8 text")
        try:
            self.root = _parsed(source)
        except expat.ExpatError as error:
            raise InputError(ErrorCode.BAD_INPUT, f"the model is not well-formed XML ({error})") from error
        if self.root.name != root:
            raise InputError(ErrorCode.BAD_INPUT, f"the root element is <{self.root.name}>, expected <{root}>")

    def set_attributes(self, element: XmlElement, values: dict[str, str], without: tuple[str, ...] = ()) -> None:
        """Give an element attributes; those that it has keep their places; some are taken out."""
        tag = self._tags.get(id(element), self._source[element.start : element.inside])
        for name in without:
            tag = _with_attribute(tag, name.encode(), b"")
        for name, value in values.items():
            tag = _with_attribute(tag, name.encode(), f"{name}={quoteattr(value)}".encode())
        self._tags[id(element)] = tag
        self._edits = [each for each in self._edits if each[:2] != (element.start, element.inside)]
        self._edits.append((element.start, element.inside, tag))

    def between(self, element: XmlElement) -> str:
        """The text between the tags of an element."""
        return self._source[element.inside : element.stop].decode("utf-8")

    def set_text(self, element: XmlElement, text: str) -> None:
        """Replace what is between the tags of an element."""
        if element.stop == element.end:  # <name/>
            self.replace(element, f"<{element.name}>{text}</{element.name}>")
        else:
            self._edits.append((element.inside, element.stop, text.encode()))

    def replace(self, element: XmlElement, text: str) -> None:
        """Put something in the place of an element."""
        self._edits.append((element.start, element.end, text.encode()))

    def put_child(self, element: XmlElement, text: str) -> None:
        """Put an element in the place of the child of the same name; where there is none, before the content."""
        old = element.child(re.match(r"<(\w+)", text)[1])  # type: ignore[index]
        if old is None:
            self.insert_first(element, text)
        else:
            self.replace(old, text)

    def insert_first(self, element: XmlElement, text: str) -> None:
        """Put something before the content of an element, on a line of its own."""
        line = self._source.rfind(b"\n", 0, element.start) + 1
        indent = re.match(rb"[ \t]*", self._source[line:]).group() + b"  "  # type: ignore[union-attr]
        if element.stop == element.end:
            tag = re.sub(rb"\s*/>$", b">", self._source[element.start : element.inside])
            closing = b"\n" + indent[:-2] + f"</{element.name}>".encode()
            self._edits.append((element.start, element.end, tag + b"\n" + indent + text.encode() + closing))
        else:
            self._edits.append((element.inside, element.inside, b"\n" + indent + text.encode()))

    def changed(self, remark: str) -> bytes:
        """The file with the changes, and a comment before the root element."""
        text = self._source
        comment = f"<!-- {remark} -->\n".encode()
        for start, end, new in sorted([*self._edits, (self.root.start, self.root.start, comment)], reverse=True):
            text = text[:start] + new + text[end:]
        return text


def _parsed(source: bytes) -> XmlElement:
    parser = expat.ParserCreate()
    open_elements: list[XmlElement] = []
    roots: list[XmlElement] = []

    def start(name: str, attributes: dict[str, str]) -> None:
        parent = open_elements[-1] if open_elements else None
        element = XmlElement(name, attributes, parent, parser.CurrentByteIndex)
        element.inside = _end_of_tag(source, element.start)
        (roots if parent is None else parent.children).append(element)
        open_elements.append(element)

    def end(_: str) -> None:
        element = open_elements.pop()
        element.stop = parser.CurrentByteIndex
        if source[element.inside - 2 : element.inside] == b"/>":
            element.stop = element.end = element.inside
        else:
            element.end = source.index(b">", element.stop) + 1

    def refuse(*_: object) -> None:
        raise InputError(ErrorCode.BAD_INPUT, "the model declares a document type or entities; remove them")

    parser.StartElementHandler, parser.EndElementHandler = start, end
    parser.StartDoctypeDeclHandler = parser.EntityDeclHandler = refuse
    parser.Parse(source, True)
    return roots[0]


def _with_attribute(tag: bytes, name: bytes, given: bytes) -> bytes:
    """A start tag with an attribute, in the place of the one that it has."""
    for found in _ATTRIBUTE.finditer(tag):
        if found[1] == name:
            return tag[: found.start()] + given + tag[found.end() :]
    if not given:
        return tag
    return re.sub(rb"\s*(/?>)$", lambda end: b" " + given + end[1], tag)


def _end_of_tag(source: bytes, begin: int) -> int:
    """The byte after a start tag; > may stand in its attributes."""
    found = re.compile(rb"<(?:[^>\"']|\"[^\"]*\"|'[^']*')*>").match(source, begin)
    return begin if found is None else found.end()
