"""The messages of mindstage_msgs: how a call ended, and where joints stand."""

from __future__ import annotations

from mindstage.msgs.geometry_msgs import Point, Vector3
from mindstage.msgs.message import Message
from mindstage.msgs.primitives import Bool, Float64, String, Uint32
from mindstage.msgs.std_msgs import ColorRGBA

__all__ = ["Failure", "Force", "JointPosition", "LitBodies", "LitGroups", "Note", "Refusal", "SpawnReport"]


class Refusal(Message, frozen=True):
    """Why the world said no; all empty where it did not."""

    kind: String = ""
    """The name of the error, such as `BodyUnknown`."""
    text: String = ""
    """The sentence for people."""
    body: String = ""
    """The body that it is about."""
    parent: String = ""
    """Where something was to be attached: to what, and what."""
    child: String = ""
    reason: String = ""
    world: String = ""
    near: tuple[String, ...] = ()
    """What may have been meant."""


class Failure(Message, frozen=True):
    """Something that could not be spawned."""

    id: String = ""
    reason: String = ""


class Note(Message, frozen=True):
    """One decision that the engine made because the map does not."""

    kind: String = ""
    ids: tuple[String, ...] = ()
    text: String = ""


class SpawnReport(Message, frozen=True):
    """What became of a world that was to be spawned; its fields are those of the engine's own report."""

    bodies: Uint32 = 0
    constraints: Uint32 = 0
    attachments: Uint32 = 0
    failed_bodies: tuple[Failure, ...] = ()
    failed_constraints: tuple[Failure, ...] = ()
    failed_attachments: tuple[Failure, ...] = ()
    notes: tuple[Note, ...] = ()


class Force(Message, frozen=True):
    """What pushes a body for a while."""

    id: String = ""
    force: Vector3 = Vector3()
    """[N], world frame."""
    at_point: Bool = False
    """Else it acts on the centre of mass."""
    point: Point = Point()
    """[m], world frame."""


class JointPosition(Message, frozen=True):
    """How far a constraint has moved from where it was spawned."""

    id: String = ""
    x: Float64 = 0.0
    """[m]."""
    y: Float64 = 0.0
    z: Float64 = 0.0
    twist: Float64 = 0.0
    """[rad]."""
    swing2: Float64 = 0.0
    swing1: Float64 = 0.0


class LitBodies(Message, frozen=True):
    """Bodies that are to be lit, or are, in one colour and for one reason."""

    ids: tuple[String, ...] = ()
    """Or IRIs, where something is to be lit."""
    color: ColorRGBA = ColorRGBA()
    """What is wholly transparent puts out."""
    label: String = ""
    """Why, in one line; what is lit for the same reason replaces what was lit for it before."""


class LitGroups(Message, frozen=True):
    """All that is lit, the latest last."""

    groups: tuple[LitBodies, ...] = ()
