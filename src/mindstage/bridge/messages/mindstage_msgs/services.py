"""The services and actions of mindstage_msgs: an engine's whole contract, and questions, over the wire.

A world and its parts travel as JSON in one string (`mindstage.bridge.description.to_json`), exact and complete: ROS has
no word for a value that is not told, and no place for a fact. Every reply but that of `Describe` has `success`; where
it is false, `refusal` says why the world said no. What lies outside of the world ends the call itself, with a text
(`result: false`; `mindstage.bridge.description.error_text`). `engine_service` says where they are offered.
"""
# ruff: noqa: D106 - Request and Response say what they are

from __future__ import annotations

from mindstage.bridge.messages.geometry_msgs import Point, Pose, Vector3
from mindstage.bridge.messages.message import Action, Message, Service
from mindstage.bridge.messages.mindstage_msgs.messages import JointPosition, Refusal, SpawnReport
from mindstage.bridge.messages.primitives import Bool, Float64, String, Uint32
from mindstage.bridge.messages.std_msgs import ColorRGBA

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
    "Push",
    "RestoreState",
    "SaveState",
    "SetMaterials",
    "SetPhysics",
    "SetPose",
    "SetSpeed",
    "Simulate",
    "SpawnMap",
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


class SpawnWorld(Service):
    """Adds a world; what cannot be spawned stands in the report, and `success` says whether that is nothing."""

    class Request(Message, frozen=True):
        world: String = ""

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

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class Detach(Service):
    """Lets go of a child."""

    class Request(Message, frozen=True):
        child: String = ""

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SetPose(Service):
    """Puts a body somewhere else, at rest, with all that hangs on it."""

    class Request(Message, frozen=True):
        id: String = ""
        pose: Pose = Pose()

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()


class SetPhysics(Service):
    """Changes how a body takes part in the physics."""

    class Request(Message, frozen=True):
        id: String = ""
        physics: String = ""
        """The JSON of a `Physics`."""

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

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0
        """What time it is then."""


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
        pass

    class Response(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0
        ids: tuple[String, ...] = ()
        poses: tuple[Pose, ...] = ()


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


class SpawnMap(Action):
    """Spawns a world, and tells how far it is."""

    class Goal(Message, frozen=True):
        world: String = ""

    class Result(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        report: SpawnReport = SpawnReport()

    class Feedback(Message, frozen=True):
        phase: String = ""
        done: Uint32 = 0
        total: Uint32 = 0


class Simulate(Action):
    """Lets time pass, and tells how much has."""

    class Goal(Message, frozen=True):
        duration_s: Float64 = 0.0

    class Result(Message, frozen=True):
        success: Bool = False
        refusal: Refusal = Refusal()
        time_s: Float64 = 0.0

    class Feedback(Message, frozen=True):
        elapsed_s: Float64 = 0.0
        remaining_s: Float64 = 0.0
