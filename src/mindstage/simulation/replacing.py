"""The edit that replaces all worlds of a simulation with its knowledge base, such as loading a map."""

from __future__ import annotations

import secrets
from collections.abc import Iterator, Mapping
from typing import Any
from weakref import WeakValueDictionary

from mindstage.engines.base import SavedState
from mindstage.engines.edits import RestoreBodies
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyGeometry
from mindstage.scene.edits import Edit, Spawn

__all__ = ["KeptWorld", "ReplaceWorld", "additions", "edit_timeout_s", "primitives"]


class KeptWorld:
    """A map that is to be spawned, or what was replaced: worlds, knowledge base, robots, and the state of the engine.

    It exists as long as something refers to it, such as the undo history. In the JSON of an edit it is a reference,
    which can be read in this process only.
    """

    __slots__ = ("__weakref__", "contents", "owner", "reference", "spawn", "state")

    def __init__(
        self,
        owner: object,
        contents: Mapping[str, Any],
        *,
        state: SavedState | None = None,
        spawn: Spawn | None = None,
    ) -> None:
        """Keeps the given objects.

        Args:
            owner: the simulation that it is of.
            contents: the attributes of the simulation that are about its worlds, the knowledge base included.
            state: the state of the engine; None for a map, or if the engine cannot save its state.
            spawn: what is spawned into an empty engine; None for what was replaced.
        """
        self.owner, self.contents, self.state, self.spawn = owner, contents, state, spawn
        self.reference = secrets.token_hex(16)
        _kept[self.reference] = self

    @property
    def knowledge(self) -> KnowledgeBase:
        """The knowledge base."""
        knowledge: KnowledgeBase = self.contents["knowledge"]
        return knowledge

    def to_edit_json(self) -> str:
        """The reference; see `scene.edits`."""
        return self.reference

    @classmethod
    def from_edit_json(cls, value: Any, _: Mapping[str, BodyGeometry]) -> KeptWorld:
        """What a reference refers to.

        Raises:
            ValueError: it is not kept, or not any more.
        """
        if (found := _kept.get(value) if isinstance(value, str) else None) is None:
            raise ValueError("that world is not kept here any more; load the map again")
        return found


_kept: WeakValueDictionary[str, KeptWorld] = WeakValueDictionary()


class ReplaceWorld(Edit, frozen=True):
    """Replaces all worlds, robots and the knowledge base of a simulation; see `Simulation.replace_world`.

    `Simulation.apply` makes it, not the engine. The inverse restores what was replaced, bit for bit, with the state of
    the engine; it raises `UnsupportedByEngineError` if the engine cannot save its state.
    """

    world: KeptWorld

    @property
    def label(self) -> str:
        """See `Edit`."""
        return self.title or "world replaced"


_ADDITION_S = 0.05
"""By how much the timeout of an edit is longer for each body and joint that it adds [s]."""


def primitives(edit: Edit) -> Iterator[Edit]:
    """The edits that engines make for an edit."""
    if parts := edit.parts():
        for each in parts:
            yield from primitives(each)
    else:
        yield edit


def additions(edit: Edit) -> tuple[Spawn | RestoreBodies, ...]:
    """The parts of an edit that add bodies."""
    if isinstance(edit, ReplaceWorld):
        return () if edit.world.spawn is None else (edit.world.spawn,)
    return tuple(each for each in primitives(edit) if isinstance(each, Spawn | RestoreBodies))


def edit_timeout_s(edit: Edit, timeout_s: float) -> float:
    """The timeout of an edit [s], from that of an edit that adds nothing."""
    count = sum(len(each.world.bodies) + len(each.world.joints) for each in additions(edit))
    return timeout_s + _ADDITION_S * count
