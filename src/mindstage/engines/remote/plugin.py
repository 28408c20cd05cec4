"""Plugin: the services of Unreal's UROSWorldControl, by the names that it gives them."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Sequence
from typing import Any

from mindstage.engines.remote.link import Link
from mindstage.msgs import Message, Service, snake_case
from mindstage.msgs import world_control_msgs as wire
from mindstage.world import BodyId

__all__ = ["PART_S", "Plugin"]

PART_S = 0.05
"""So much longer may a call take for each model or constraint that it is about [s]."""
_NAMES: dict[type[Service], str] = {wire.SetMaterial: "change_material", wire.HighlightModel: "highlight_models"}
"""Services that are not called after their type."""
_NOBODY = wire.GetModelPose.Request(id="mindstage-ping")


class Plugin:
    """Calls one plugin."""

    def __init__(self, link: Link) -> None:
        self.link = link

    @property
    def is_there(self) -> bool:
        """Whether anybody at the other end offers its services."""
        return self.link.is_offered(self._place(wire.GetModelPose), wire.GetModelPose, _NOBODY)

    def call(self, service: type[Service], request: Message, *, parts: int = 0) -> Any:
        """Calls one service.

        Args:
            service: which.
            request: every field of it is sent.
            parts: how many models and constraints it is about, and so how long it may take.
        """
        self.link.be_ready()
        patience_s = self.link.timeout_s + PART_S * parts
        return self.link.call(self._place(service), service, request, timeout_s=patience_s)

    def call_each(self, service: type[Service], requests: Sequence[Message]) -> Iterator[Any]:
        """Calls one service many times; the responses come in the order of the requests."""
        self.link.be_ready()
        patience_s = self.link.timeout_s + PART_S * len(requests)
        return self.link.call_each(self._place(service), service, requests, timeout_s=patience_s)

    def poses(self, ids: Iterable[BodyId]) -> list[wire.GetModelPose.Response]:
        """Where models are; they are read one by one."""
        return list(self.call_each(wire.GetModelPose, [wire.GetModelPose.Request(id=id) for id in ids]))

    def ping(self) -> None:
        """Asks for a sign of life: where somebody is whom nobody knows."""
        self.call(wire.GetModelPose, _NOBODY)

    def delete(self, ids: Iterable[BodyId]) -> tuple[BodyId, ...]:
        """Takes models away; gives those that are still there."""
        wanted = tuple(ids)
        replies = self.call_each(wire.DeleteModel, [wire.DeleteModel.Request(id=id) for id in wanted])
        refused = [id for id, reply in zip(wanted, replies, strict=True) if not reply.success]
        return tuple(id for id, reply in zip(refused, self.poses(refused), strict=True) if reply.success)

    def _place(self, service: type[Service]) -> str:
        name = _NAMES.get(service) or snake_case(service)
        return "/".join(("", *filter(None, self.link.address.namespace.split("/")), name))
