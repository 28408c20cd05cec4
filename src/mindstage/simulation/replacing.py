"""The edit that replaces all worlds of a simulation with its knowledge base, such as loading a map."""

from __future__ import annotations

import secrets
from collections.abc import Mapping
from typing import Any
from weakref import WeakValueDictionary

from mindstage.engines.base import SavedState
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyGeometry
from mindstage.scene.edits import Edit, Spawn

__all__ = ["KeptWorld", "ReplaceWorld"]


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
