"""Meeting: finds out who answers at an address, and makes the engine that speaks with it."""

from __future__ import annotations

from typing import Any

from mindstage.bridge.access import is_loopback
from mindstage.engines.remote.address import Address, Profile
from mindstage.engines.remote.engine import RemoteEngine
from mindstage.engines.remote.link import Link
from mindstage.engines.remote.mindstage import MindstageEngine, ShowForm
from mindstage.engines.remote.planned import PlannedEngine
from mindstage.engines.remote.unreal import UnrealEngine
from mindstage.errors import BridgeError, EngineUnavailable
from mindstage.msgs import engine_service
from mindstage.msgs import mindstage_msgs as wire

__all__ = ["meet"]

_SIGNS = ("/mindstage/describe", "/spawn_semantic_map")
"""How services end that tell where an engine is."""


def meet(address: Address, *, profile: Profile | None, timeout_s: float, holds_time: bool) -> RemoteEngine:
    """See `RemoteEngine.connect`."""
    link = Link(address, timeout_s=timeout_s)
    try:
        # In this order: a Mindstage answers as Unreal's plugin does, too.
        if profile is not Profile.UNREAL and MindstageEngine.is_offered(link):
            return _mindstage(link, holds_time=holds_time)
        if profile is not Profile.MINDSTAGE and UnrealEngine.is_offered(link):
            return UnrealEngine(link)
        what = f"no engine of the profile {profile.value}" if profile else "no engine"
        raise EngineUnavailable(
            link.name, cause=f"{what} answers below /{address.namespace} there", remedy=_where_else(link)
        )
    except BaseException:
        link.close()
        raise


def _mindstage(link: Link, *, holds_time: bool) -> MindstageEngine:
    """The engine of a Mindstage, or one that wants to be told as well what Mindstage decides."""
    name = engine_service(wire.Describe, link.address.namespace)
    far: Any = link.call(name, wire.Describe, wire.Describe.Request())
    kind = PlannedEngine if "plan" in far.takes else MindstageEngine
    return kind(link, holds_time=holds_time, show=_show(link.address))


def _show(address: Address) -> ShowForm:
    """Files go where whoever is on this machine can read them."""
    if not is_loopback(address.host):
        return lambda form: ""
    from mindstage.exports import shelve

    return shelve


def _where_else(link: Link) -> str:
    """What to try, from what the hub says that there is."""
    try:
        names = link.values("/rosapi/services", timeout_s=min(link.timeout_s, 2.0))["services"]
        found = {name.removesuffix(sign).strip("/") for name in names for sign in _SIGNS if name.endswith(sign)}
    except (BridgeError, KeyError, TypeError, AttributeError):
        found = set()
    if not found:
        return "start mindstage serve there, or let Unreal's plugin join that rosbridge"
    return f"there is one below {', '.join(f'/{name}' for name in sorted(found))}"
