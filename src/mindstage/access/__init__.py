"""Access: who may use a running Mindstage, how much of it, and what a text from outside may name."""

from mindstage.access.certificates import TlsCertificate
from mindstage.access.gate import Gate
from mindstage.access.limits import LIMITS, BridgeLimits, Limit, RpcLimits, VisitorLimits

__all__ = ["LIMITS", "BridgeLimits", "Gate", "Limit", "RpcLimits", "TlsCertificate", "VisitorLimits"]

__dir__ = __all__.copy
