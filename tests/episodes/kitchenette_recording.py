"""A recording of the small kitchen: its drawer is opened, the mug is attached to it, carried and let go."""

from __future__ import annotations

from functools import cache

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording
from mindstage.scene import BodyId, Pose
from mindstage.scene.edits import Attach, Detach, SetPoses
from tests.kitchenette import kitchenette

FRAMES_PER_S = 30
MUG = BodyId("Mug")
DRAWER = BodyId("Drawer")


def frame_of(simulation: Simulation, time_s: float, before: EpisodeFrame | None = None) -> EpisodeFrame:
    """The current state as a frame; `structure` and `ids` are those of the frame before if nothing was edited."""
    world, snapshot = simulation.snapshot(), simulation.state
    attachments = before is not None and before.structure.attachments == world.attachments
    return EpisodeFrame(
        time_s=time_s,
        structure=before.structure if before is not None and attachments and before.ids == snapshot.ids else world,
        ids=before.ids if before is not None and before.ids == snapshot.ids else snapshot.ids,
        poses=snapshot.poses.copy(),
        joint_positions=simulation.engine.run(lambda engine: dict(engine.joint_positions())),
        contacts=simulation.engine.run(lambda engine: engine.contacts()),
    )


@cache
def kitchenette_recording(*, pull: float = 1.0) -> FrameRecording:
    """Four seconds: at 0.5 s the drawer is pulled open, at 2 s the mug is lifted, at 3 s it falls to the floor.

    Args:
        pull: the distance by which the drawer is pulled, as a factor.
    """
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        geometry = simulation.geometry
        frames: list[EpisodeFrame] = []
        for number in range(4 * FRAMES_PER_S + 1):
            if number == FRAMES_PER_S // 2:
                simulation.pull(DRAWER, point=(-0.25, 0.0, 0.0), target=(1.7 - 0.6 * pull, 0.0, 0.65))
            if number == 2 * FRAMES_PER_S:
                simulation.release()
                set_pose(simulation, Pose((1.0, 0.0, 1.5)))
                simulation.engine.run(lambda engine: engine.apply(Attach(DRAWER, MUG)), edits=True)
            if number == 3 * FRAMES_PER_S:
                simulation.engine.run(lambda engine: engine.apply(Detach(MUG)), edits=True)
            frames.append(frame_of(simulation, number / FRAMES_PER_S, frames[-1] if frames else None))
            simulation.step(1 / FRAMES_PER_S)
    return FrameRecording(
        frames, name="kitchenette.mcap", start_unix_s=1.8e9, geometry=geometry, spawned=(kitchenette(),), events=EVENTS
    )


def set_pose(simulation: Simulation, pose: Pose) -> None:
    simulation.engine.run(lambda engine: engine.apply(SetPoses({MUG: pose})), edits=True)


EVENTS = (
    EpisodeEvent(
        id="Opening_1",
        kind=EpisodeEventKind.OPEN,
        begin_s=0.5,
        end_s=1.5,
        thing=DRAWER,
        joint=BodyId("DrawerSlide"),
        amount=0.4,
        evidence=("DrawerSlide moved by 0.40 m.",),
    ),
    EpisodeEvent(
        id="Grasping_1",
        kind=EpisodeEventKind.GRASP,
        begin_s=2.0,
        end_s=3.0,
        thing=MUG,
        other=DRAWER,
        agent="Drawer",
        evidence=("Mug is attached to Drawer.",),
    ),
    EpisodeEvent(
        id="Falling_1",
        kind=EpisodeEventKind.FALL,
        begin_s=3.0,
        end_s=3.5,
        thing=MUG,
        amount=1.45,
        evidence=("Mug fell by 1.45 m.",),
    ),
)
"""What happened, written by hand."""
