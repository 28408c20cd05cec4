"""Remote: an engine at the other end of a rosbridge."""

from mindstage.engines.remote.address import SCHEME, Address, Profile
from mindstage.engines.remote.engine import RemoteEngine

__all__ = ["SCHEME", "Address", "Profile", "RemoteEngine"]
