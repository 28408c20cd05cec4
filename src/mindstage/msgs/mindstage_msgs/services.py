"""The services of mindstage_msgs: an engine's whole contract, and questions, over the wire.

A world and its parts travel as JSON in one string (`mindstage.bridge.description.to_json`), exact and complete: ROS has
no word for a value that is not told, and no place for a fact. Every reply but that of `Describe` has `success`; where
it is false, `refusal` says why the world said no. What lies outside of the world ends the call itself, with a text
(`result: false`; `mindstage.bridge.description.error_text`). `engine_service` says where they are offered.

`forms` and `plan` are for engines that say in `Describe` that they take them, and empty otherwise: what bodies are made
of, and who moves with whom, collides with whom and weighs how much (`mindstage.bridge.description.forms`, `.plans`).
"""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from mindstage.msgs.geometry_msgs import Point, Pose, Vector3
from mindstage.msgs.message import Message, Service
from mindstage.msgs.mindstage_msgs.messages import Force, JointPosition, Refusal, SpawnReport
from mindstage.msgs.primitives import Bool, Bytes, Float64, String, Uint32
from mindstage.msgs.std_msgs import ColorRGBA

__all__ = [
    "Ask",
    "Attach",
    "Clear",
    "Delete",
    "Describe",
    "Detach",
    "ForgetState",
    "GetHighlights",
    "GetJointPositions",
    "GetPoses",
    "Highlight",
    "LogWorld",
    "Photograph",
    "Push",
    "RestoreState",
    "SaveScene",
    "SaveState",
    "SetMaterials",
    "SetPhysics",
    "SetPose",
    "SetSpeed",
    "SpawnWorld",
    "Step",
]


class Describe(Service):
    """Which engine runs there, what it can do, and what time it is; answers quickly, so it is the ping too."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        engine: String = ""
        abilities: tuple[String, ...] = ()
        """Such as `save` and `joints`."""
        time_s: Float64 = 0.0
        format_version: Uint32 = 0
        """Of the worlds that it reads."""
        session: String = ""
        """Made anew whenever the engine starts: another one means that the world of before is gone."""
        takes: tuple[String, ...] = ()
        """What else may be told with a world: `forms`, and `plan` by an engine that leaves decisions to us."""


class SpawnWorld(Service):
    """Adds a world; what cannot be spawned stands in the report, and `success` says whether that is nothing."""

    class Request(Message, frozen=True):
        world: String = ""
        forms: String = ""
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        report: SpawnReport = SpawnReport()


class LogWorld(Service):
    """The world as it is now."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        world: String = ""


class Delete(Service):
    """Takes bodies away, all of them or none."""

    class Request(Message, frozen=True):
        ids: tuple[String, ...] = ()
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Clear(Service):
    """Takes everything away."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Attach(Service):
    """Hangs the child on the parent."""

    class Request(Message, frozen=True):
        parent: String = ""
        child: String = ""
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Detach(Service):
    """Lets go of a child."""

    class Request(Message, frozen=True):
        child: String = ""
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SetPose(Service):
    """Puts a body somewhere else, at rest, with all that hangs on it."""

    class Request(Message, frozen=True):
        id: String = ""
        pose: Pose = Pose()
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SetPhysics(Service):
    """Changes how a body takes part in the physics."""

    class Request(Message, frozen=True):
        id: String = ""
        physics: String = ""
        """The JSON of a `Physics`."""
        plan: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SetMaterials(Service):
    """Changes a body's surface."""

    class Request(Message, frozen=True):
        id: String = ""
        materials: String = ""
        """A JSON array of `Material`s."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Highlight(Service):
    """Lights bodies up in any colour, or puts them out; all of them or none."""

    class Request(Message, frozen=True):
        ids: tuple[String, ...] = ()
        lit: Bool = False
        color: ColorRGBA = ColorRGBA()
        """Counts where `lit` is true; opacity does not."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class GetHighlights(Service):
    """Which bodies are lit, and how; both lists run in parallel."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        ids: tuple[String, ...] = ()
        colors: tuple[ColorRGBA, ...] = ()


class Push(Service):
    """Applies a force throughout the next step."""

    class Request(Message, frozen=True):
        id: String = ""
        force: Vector3 = Vector3()
        """[N], world frame."""
        at_point: Bool = False
        """Else it acts on the centre of mass."""
        point: Point = Point()
        """[m], world frame."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Step(Service):
    """Lets time pass."""

    class Request(Message, frozen=True):
        duration_s: Float64 = 0.0
        forces: tuple[Force, ...] = ()
        """Applied throughout this step."""
        packed: Bool = False
        """Whether to tell where all bodies are then."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0
        """What time it is then."""
        revision: Uint32 = 0
        """As in `GetPoses`."""
        rows: Bytes = b""


class SetSpeed(Service):
    """How fast time passes over there by itself: 0 not at all, so that it passes by `Step` only."""

    class Request(Message, frozen=True):
        speed: Float64 = 0.0
        """1 is real time."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        before: Float64 = 0.0
        """How fast it passed."""


class GetPoses(Service):
    """Where all bodies are; both lists run in parallel."""

    class Request(Message, frozen=True):
        packed: Bool = False
        """Whether to tell it in `rows`, not in `poses`."""
        known: Uint32 = 0
        """A revision whose ids are known: if it is still that one, they are not told again."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0
        ids: tuple[String, ...] = ()
        poses: tuple[Pose, ...] = ()
        revision: Uint32 = 0
        """Another one whenever a body comes or goes; never 0."""
        rows: Bytes = b""
        """Seven doubles a body, little endian: x y z, then w x y z."""


class GetJointPositions(Service):
    """How far each constraint has moved (ability `joints`)."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        joints: tuple[JointPosition, ...] = ()


class SaveState(Service):
    """Keeps the whole state over there, under a name that the reply gives (ability `save`)."""

    class Request(Message, frozen=True):
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        handle: String = ""


class RestoreState(Service):
    """Brings a kept state back (ability `save`)."""

    class Request(Message, frozen=True):
        handle: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class ForgetState(Service):
    """Throws a kept state away; nothing happens if there is none."""

    class Request(Message, frozen=True):
        handle: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SaveScene(Service):
    """Writes what stands there to a file of the engine's own format, where the engine runs (ability `scenes`)."""

    class Request(Message, frozen=True):
        path: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Photograph(Service):
    """Writes a picture of what stands there to a PNG file, where the engine runs (ability `pictures`)."""

    class Request(Message, frozen=True):
        path: String = ""
        width: Uint32 = 0
        height: Uint32 = 0
        eye: Point = Point()
        target: Point = Point()
        """What is in the middle of the picture."""
        fov_deg: Float64 = 0.0
        """From its upper to its lower edge."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Ask(Service):
    """Asks any declared question."""

    class Request(Message, frozen=True):
        question: String = ""
        args: String = ""
        """A JSON object, argument by name; empty for none."""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        answers: String = ""
        """The JSON that `mindstage ask --json` prints."""
