"""Remote: an engine at the other end of a rosbridge."""

from mindstage.engines.remote.client import SCHEME, RemoteProfile, RemoteUrl
from mindstage.engines.remote.engine import RemoteEngine

__all__ = ["SCHEME", "RemoteEngine", "RemoteProfile", "RemoteUrl"]
