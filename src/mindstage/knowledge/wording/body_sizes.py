"""Bodies' sizes: told by their classes, or by themselves where they differ from what their classes say.

Only the classes that a world holds as resources count for what a body need not say itself, since only those go into
the same file. A size that comes from an ontology is said by the body.
"""

from __future__ import annotations

from mindstage.knowledge.vocabulary import UNTOLD
from mindstage.knowledge.wording.sizes import Axes, ClassSizes
from mindstage.knowledge.wording.statements import Heard, Said
from mindstage.knowledge.wording.words import SIZE
from mindstage.world import Iri, Vector

__all__ = ["hear_size", "say_size"]


def hear_size(heard: Heard, classes: tuple[Iri, ...], *, known: ClassSizes, resources: ClassSizes) -> Vector | None:
    """The size of a body; None where not all three extents are known, and then what is told stays facts.

    Args:
        heard: what is told about the body.
        classes: its classes, the most telling one first.
        known: what all sources say about classes.
        resources: what the classes among the world's resources say.
    """
    if any(heard.is_untold(word.property) for word in SIZE):
        if None not in _filled(heard, resources.of(classes)):
            heard.take_mark(SIZE[0].property)
        return None
    own = [heard.value(word, keep=lambda _: True) for word in SIZE]
    x, y, z = (inherited if told is None else told for told, inherited in zip(own, known.of(classes), strict=True))
    if x is None or y is None or z is None:
        missing = [word.property for word, extent in zip(SIZE, (x, y, z), strict=True) if extent is None]
        if len(missing) < len(SIZE):
            heard.warn(missing[0], "its size is told in part only", "it has none")
        return None
    for word, inherited in zip(SIZE, resources.of(classes), strict=True):
        heard.value(word, keep=lambda extent, inherited=inherited: extent == inherited)  # type: ignore[misc]
    return x, y, z


def say_size(said: Said, classes: tuple[Iri, ...], size: Vector | None, resources: ClassSizes) -> None:
    """Says of a size what the classes do not."""
    inherited = resources.of(classes)
    if size is None:
        if None not in _filled(said, inherited):
            said.add(UNTOLD, SIZE[0].property)
        return
    for word, extent, given in zip(SIZE, size, _filled(said, inherited), strict=True):
        if extent != given:
            said.value(word, extent)


def _filled(thing: Said | Heard, inherited: Axes) -> Axes:
    """What a reader would find if nothing more were said, and no mark were set."""
    x, y, z = (
        given if told is None else told
        for told, given in zip((thing.told(word) for word in SIZE), inherited, strict=True)
    )
    return x, y, z
