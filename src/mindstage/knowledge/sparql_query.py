"""The text of a SPARQL query, as far as it concerns graphs, prefixes and the order of columns.

The text is divided into tokens, not parsed: whether a query is valid, and whether it may use other servers, is decided
by the store's own parser (see `sparql_worker`). Nothing here is a check of security.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import NamedTuple

from mindstage.errors import SparqlSyntaxError, closest_names

__all__ = ["QueryPrefixes", "SparqlText"]

_TOKEN = re.compile(
    r"""(?P<skipped>\s+|\#[^\n\r]*)"""
    r'''|(?P<string>"""(?:[^"\\]|\\.|"(?!""))*"""|\'\'\'(?:[^'\\]|\\.|'(?!''))*\'\'\'|"(?:[^"\\\n\r]|\\.)*"'''
    r"""|'(?:[^'\\\n\r]|\\.)*')"""
    r"""|(?P<iri><[^<>"{}|^`\\\x00-\x20]*>)"""
    r"""|(?P<variable>[?$]\w+)"""
    r"""|(?P<name>(?:[^\W\d_][\w.-]*)?:(?:[\w:.%-]|\\.)*)"""
    r"""|(?P<word>@?\w+)"""
    r"""|(?P<other>.)""",
    re.DOTALL,
)
_ESCAPE = re.compile(r"\\(.)")
_MAX_LISTED = 8
"""The number of graphs that an error lists."""


class _Token(NamedTuple):
    kind: str
    text: str
    start: int
    end: int

    def is_word(self, word: str) -> bool:
        return self.kind == "word" and self.text.upper() == word


class _GraphName(NamedTuple):
    iri: str
    token: _Token
    is_from: bool
    """Whether it is in FROM or FROM NAMED, not in GRAPH."""


class QueryPrefixes:
    """The prefixes that queries need not declare.

    The prefixes of Mindstage have one meaning everywhere. Those that loaded files declare are added, except prefixes
    with different meanings in different files, and those that a file declares otherwise than Mindstage.
    """

    def __init__(self, built_in: Mapping[str, str], declared: Iterable[tuple[str, Mapping[str, str]]]) -> None:
        """Collects the prefixes.

        Args:
            built_in: the prefixes of Mindstage.
            declared: the names of files, each with the prefixes that it declares.
        """
        found: dict[str, dict[str, str]] = {}
        for file, prefixes in declared:
            for prefix, namespace in prefixes.items():
                if prefix not in built_in:
                    found.setdefault(prefix, {}).setdefault(namespace, file)
        self.namespaces = dict(built_in) | {name: next(iter(each)) for name, each in found.items() if len(each) == 1}
        """The namespace of each prefix."""
        self._ambiguous = {prefix: each for prefix, each in found.items() if len(each) > 1}

    def check(self, query: SparqlText) -> None:
        """Refuses a query that uses a prefix which loaded files declare differently.

        Raises:
            SparqlSyntaxError: it does, and does not declare the prefix itself.
        """
        for prefix in query.undeclared_prefixes():
            if meanings := self._ambiguous.get(prefix):
                shown = " and ".join(f"<{namespace}> in {file}" for namespace, file in list(meanings.items())[:2])
                cause = f"the prefix {prefix}: has several meanings in the loaded files: {shown}"
                raise SparqlSyntaxError(cause, remedy=f"declare the one that is meant: PREFIX {prefix}: <…>")


class SparqlText:
    """The tokens of a query."""

    def __init__(self, text: str) -> None:
        """Divides the text into tokens; a text that is no query has tokens too."""
        self.text = text
        self._tokens = [
            _Token(str(found.lastgroup), found[0], found.start(), found.end())
            for found in _TOKEN.finditer(text)
            if found.lastgroup != "skipped"
        ]
        self._declared = dict(self._declarations())

    def undeclared_prefixes(self) -> Iterator[str]:
        """The prefixes that the query uses and does not declare."""
        names = (token.text.partition(":")[0] for token in self._tokens if token.kind == "name")
        return (prefix for prefix in dict.fromkeys(names) if prefix not in self._declared)

    def iris(self, prefixes: Mapping[str, str]) -> frozenset[str]:
        """The IRIs that occur anywhere in the query, in full or with a prefix."""
        found = (self._iri(token, prefixes) for token in self._tokens)
        return frozenset(iri for iri in found if iri is not None)

    def has_graph_variable(self) -> bool:
        """Whether the query is about any graph: GRAPH ?g."""
        pairs = zip(self._tokens, self._tokens[1:], strict=False)
        return any(one.is_word("GRAPH") and other.kind == "variable" for one, other in pairs)

    def mentions(self, iri: str, prefixes: Mapping[str, str]) -> bool:
        """Whether an IRI occurs anywhere in the query, in full or with a prefix."""
        return any(self._iri(token, prefixes) == iri for token in self._tokens)

    def with_graph_names(
        self, aliases: Mapping[str, str], known: Collection[str], prefixes: Mapping[str, str]
    ) -> SparqlText:
        """The query with the graphs of FROM, FROM NAMED and GRAPH under the names that they have in the store.

        Args:
            aliases: other names of graphs, such as the URLs of their files, with the names in the store.
            known: the names in the store.
            prefixes: the prefixes besides those that the query declares.

        Raises:
            SparqlSyntaxError: FROM or FROM NAMED has a name that no graph has.
        """
        text = self.text
        for name in reversed(list(self._graph_names(prefixes))):
            if name.iri in known:
                continue
            if name.iri in aliases:
                text = f"{text[: name.token.start]}<{aliases[name.iri]}>{text[name.token.end :]}"
            elif name.is_from:
                raise _unknown_graph_error(name.iri, [*known, *aliases], sorted(known))
        return self if text == self.text else SparqlText(text)

    def sorted_columns(self, columns: Sequence[str]) -> Sequence[str]:
        """The columns of the result: for SELECT *, in the order in which the variables first occur in the query."""
        select = next((at for at, token in enumerate(self._tokens) if token.is_word("SELECT")), None)
        if select is None:
            return columns
        rest = (token for token in self._tokens[select + 1 :] if token.text.upper() not in {"DISTINCT", "REDUCED"})
        if next((token.text for token in rest), "") != "*":
            return columns
        order = list(dict.fromkeys(token.text[1:] for token in self._tokens if token.kind == "variable"))
        return sorted(columns, key=lambda column: order.index(column) if column in order else len(order))

    def _declarations(self) -> Iterator[tuple[str, str]]:
        for keyword, name, iri in zip(self._tokens, self._tokens[1:], self._tokens[2:], strict=False):
            if keyword.is_word("PREFIX") and name.kind == "name" and iri.kind == "iri":
                yield name.text[:-1], iri.text[1:-1]

    def _graph_names(self, prefixes: Mapping[str, str]) -> Iterator[_GraphName]:
        before, last = _Token("", "", 0, 0), _Token("", "", 0, 0)
        for token in self._tokens:
            is_from = last.is_word("FROM") or (last.is_word("NAMED") and before.is_word("FROM"))
            iri = self._iri(token, prefixes)
            if iri is not None and (is_from or last.is_word("GRAPH")):
                yield _GraphName(iri, token, is_from)
            before, last = last, token

    def _iri(self, token: _Token, prefixes: Mapping[str, str]) -> str | None:
        if token.kind == "iri":
            return token.text[1:-1]
        if token.kind != "name":
            return None
        prefix, _, local = token.text.partition(":")
        namespace = self._declared.get(prefix, prefixes.get(prefix))
        return None if namespace is None else namespace + _ESCAPE.sub(r"\1", local)


def _unknown_graph_error(name: str, names: Collection[str], shown: Sequence[str]) -> SparqlSyntaxError:
    meant = closest_names(name, [each for each in names if not each.startswith("file:")])  # visitors see no paths
    listed = ", ".join(f"<{each}>" for each in (meant or shown)[:_MAX_LISTED])
    more = f" and {len(shown) - _MAX_LISTED} more" if not meant and len(shown) > _MAX_LISTED else ""
    remedy = f"near: {listed}" if meant else f"there is {listed}{more}" if listed else "no file is loaded"
    return SparqlSyntaxError(f"no graph is named <{name}>, and nothing is fetched for FROM", remedy=remedy)
