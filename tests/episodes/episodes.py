"""Episodes for tests of formats: a simulated one, and any valid one."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
import pytest
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn, SearchStrategy

from mindstage.engines.mujoco import MujocoEngine
from mindstage.episodes import EpisodeEvent, EpisodeEventKind, EpisodeFrame, FrameRecording, event_process
from mindstage.knowledge import KnowledgeBase
from mindstage.scene import BodyId
from mindstage.simulation import Simulation
from tests.kitchenette import kitchenette

__all__ = ["EVENTS", "episodes", "execute_in_detection", "failing_detection", "kitchenette_episode"]

MUG, DRAWER = BodyId("Mug"), BodyId("Drawer")
EVENTS = (
    EpisodeEvent(
        id="SupportedBy_1",
        kind=EpisodeEventKind.SUPPORT,
        begin_s=0.0,
        end_s=None,
        thing=MUG,
        other=BodyId("Cupboard"),
        evidence=("Mug rests on Cupboard, 0.0 mm above it", "it does not move"),
    ),
    EpisodeEvent(
        id="Contact_1", kind=EpisodeEventKind.CONTACT, begin_s=0.1, end_s=0.9, thing=MUG, other=DRAWER, amount=0.5
    ),
    EpisodeEvent(
        id="Opening_1",
        kind=EpisodeEventKind.OPEN,
        begin_s=0.25,
        end_s=1.0,
        thing=DRAWER,
        joint=BodyId("DrawerSlide"),
        agent="viewer",
        amount=0.2,
    ),
    EpisodeEvent(
        id="Grasping_1",
        kind=EpisodeEventKind.GRASP,
        begin_s=0.5,
        end_s=0.75,
        thing=BodyId("DrawerHandle"),
        agent="DrawerHandle",
    ),
)


@cache
def kitchenette_episode() -> FrameRecording:
    """A second at 30 Hz, in which the drawer of the small kitchen is pulled open; the events are made up."""
    frames: list[EpisodeFrame] = []
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        world = simulation.snapshot()
        geometry = simulation.geometry
        simulation.pull(DRAWER, point=(-0.25, 0.0, 0.0), target=(1.4, 0.0, 0.65))
        for number in range(31):
            state = simulation.state
            frames.append(
                EpisodeFrame(
                    time_s=number / 30,
                    structure=world,
                    ids=frames[-1].ids if frames else state.ids,
                    poses=state.poses.copy(),
                    joint_positions=simulation.engine.run(lambda engine: dict(engine.joint_positions())),
                    contacts=simulation.engine.run(lambda engine: engine.contacts()),
                )
            )
            simulation.step(1 / 30)
    return FrameRecording(frames, name="kitchenette", start_unix_s=1_750_000_000.25, geometry=geometry, events=EVENTS)


@st.composite
def episodes(draw: DrawFn) -> FrameRecording:
    """Any episode of the small kitchen: any poses, some of which stay, at any times, and any events."""
    world = kitchenette()
    ids = tuple(body.id for body in world.bodies)
    random = np.random.default_rng(draw(st.integers(0, 2**32)))
    steps = draw(st.lists(st.floats(1e-3, 3.0), min_size=0, max_size=12))
    times = np.concatenate([[0.0], np.cumsum(steps)])
    share = draw(st.sampled_from([0.0, 0.1, 1.0]))
    poses = np.array([(*body.pose.position, *body.pose.quaternion) for body in world.bodies])
    frames = []
    for time in times.tolist():
        moved = random.random(len(ids)) < share
        poses = np.where(moved[:, None], random.normal(size=(len(ids), 7)), poses)
        poses[:, 3:] /= np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
        frames.append(EpisodeFrame(time_s=time, structure=world, ids=ids, poses=poses.copy()))
    end = float(times[-1])
    events = draw(st.lists(_events(end), max_size=6, unique_by=lambda each: each.id))
    return FrameRecording(
        frames,
        name=draw(st.text(st.characters(exclude_categories=("Cs", "Cc", "Cn")), min_size=1, max_size=8)),
        start_unix_s=draw(st.sampled_from([None, 1.75e9])),
        events=tuple(sorted(events, key=lambda each: (each.begin_s, each.id))),
    )


def _events(end_s: float) -> SearchStrategy[EpisodeEvent]:
    world = kitchenette()
    bodies = st.sampled_from([body.id for body in world.bodies])
    joints = st.sampled_from([joint.id for joint in world.joints])
    moments = st.floats(0.0, end_s, allow_subnormal=False)
    texts = st.text(st.characters(exclude_categories=("Cs", "Cc")), max_size=12)

    @st.composite
    def event(draw: DrawFn) -> EpisodeEvent:
        begin, end = sorted([draw(moments), draw(moments)])
        kind = draw(st.sampled_from(EpisodeEventKind))
        amount = draw(st.none() | st.floats(0.0, 1e6))
        return EpisodeEvent(
            id=f"{kind.value}_{draw(st.integers(1, 1000))}",
            kind=kind,
            begin_s=begin,
            end_s=None if draw(st.booleans()) else end,
            thing=draw(bodies),
            other=draw(st.none() | bodies),
            agent=draw(st.none() | bodies | st.sampled_from(["viewer", "ROS: /client 3", "Müller & Söhne"])),
            joint=draw(st.none() | joints),
            amount=amount if amount is None or math.isfinite(amount) else None,
            evidence=tuple(draw(st.lists(texts.filter(bool), max_size=3))),
        )

    return event()


def failing_detection(begin_s: float, end_s: float) -> str:
    """Code with which the detection of events fails between two times of a recording."""
    return f"""
from mindstage.episodes import tracking
sample = tracking.MotionTracker.sample
def fail(self, time_s, *args):
    if {begin_s} < time_s < {end_s}:
        raise IndexError("a planted bug")
    return sample(self, time_s, *args)
tracking.MotionTracker.sample = fail
"""


def execute_in_detection(monkeypatch: pytest.MonkeyPatch, code: str) -> None:
    """Executes code in the processes that detect events, before they do."""
    event_process.end_idle()
    monkeypatch.setattr(event_process, "_CODE", code + event_process._CODE)
    monkeypatch.setattr(event_process, "_IDLE_S", 0.0)
