"""Bodies' sizes: told by their classes, or by themselves where they differ from what their classes say.

Only the classes that a world holds as resources count for what a body need not say itself, since only those go into
the same file. A size that comes from an ontology is said by the body.
"""

from __future__ import annotations

from mindstage.knowledge.vocabulary import UNTOLD
from mindstage.knowledge.wording.sizes import ClassSizes, PartialSize
from mindstage.knowledge.wording.statements import SubjectReader, SubjectWriter
from mindstage.knowledge.wording.words import SIZE
from mindstage.world import Iri, Vector

__all__ = ["read_size", "write_size"]


def read_size(
    reader: SubjectReader, classes: tuple[Iri, ...], *, all_classes: ClassSizes, map_classes: ClassSizes
) -> Vector | None:
    """The size of a body; None where not all three extents are known, and then what is told stays facts.

    Args:
        heard: what is told about the body.
        classes: its classes, the most telling one first.
        known: what all sources say about classes.
        resources: what the classes among the world's resources say.
    """
    if any(reader.is_marked_untold(word.property) for word in SIZE):
        if None not in _effective_size(reader, map_classes.get(classes)):
            reader.consume_untold_mark(SIZE[0].property)
        return None
    own = [reader.read(word, keep_if=lambda _: True) for word in SIZE]
    x, y, z = (
        inherited if told is None else told for told, inherited in zip(own, all_classes.get(classes), strict=True)
    )
    if x is None or y is None or z is None:
        missing = [word.property for word, extent in zip(SIZE, (x, y, z), strict=True) if extent is None]
        if len(missing) < len(SIZE):
            reader.warn(missing[0], "its size is told in part only", "it has none")
        return None
    for word, inherited in zip(SIZE, map_classes.get(classes), strict=True):
        reader.read(word, keep_if=lambda extent, inherited=inherited: extent == inherited)  # type: ignore[misc]
    return x, y, z


def write_size(writer: SubjectWriter, classes: tuple[Iri, ...], size: Vector | None, map_classes: ClassSizes) -> None:
    """Says of a size what the classes do not."""
    inherited = map_classes.get(classes)
    if size is None:
        if None not in _effective_size(writer, inherited):
            writer.add_reference(UNTOLD, SIZE[0].property)
        return
    for word, extent, given in zip(SIZE, size, _effective_size(writer, inherited), strict=True):
        if extent != given:
            writer.write(word, extent)


def _effective_size(reader_or_writer: SubjectWriter | SubjectReader, inherited: PartialSize) -> PartialSize:
    """What a reader would find if nothing more were said, and no mark were set."""
    x, y, z = (
        given if told is None else told
        for told, given in zip((reader_or_writer.first_value(word) for word in SIZE), inherited, strict=True)
    )
    return x, y, z
