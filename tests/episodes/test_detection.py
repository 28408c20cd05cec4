"""The detection of events in a whole episode: a scripted kitchen, against a hand-written list of what happens in it."""

from __future__ import annotations

import os
import subprocess
import sys
from collections import defaultdict
from collections.abc import Sequence
from functools import cache
from itertools import pairwise

import numpy as np
import pytest
from msgspec.structs import replace

from mindstage import KnowledgeBase, MujocoEngine, Simulation
from mindstage.episodes import (
    EpisodeEvent,
    EpisodeEventKind,
    EpisodeFrame,
    EventDetector,
    EventState,
    FrameRecording,
    Recording,
    detect_events,
)
from mindstage.scene.spatial import SpatialRelation, SpatialRelations
from tests.episodes.kitchenette_recording import MUG, frame_of
from tests.episodes.scripted_kitchen import Expected, kitchen_episode
from tests.kitchenette import kitchenette

SYMMETRIC = {EpisodeEventKind.CONTACT, EpisodeEventKind.COLLISION}
MAX_ERROR_S = 0.1


def recording(*, noise_seed: int | None = None, contacts: bool = True) -> Recording:
    """The scripted episode, with 1 mm of noise on 5 % of the positions, or without contacts and joint positions."""
    episode, random = kitchen_episode(), np.random.default_rng(noise_seed)

    def changed(frame: EpisodeFrame) -> EpisodeFrame:
        poses = frame.poses
        if noise_seed is not None:
            poses = poses.copy()
            hit = random.random(len(poses)) < 0.05
            poses[hit, :3] += random.normal(0.0, 0.001, (hit.sum(), 3))
        return (
            replace(frame, poses=poses)
            if contacts
            else replace(frame, poses=poses, contacts=None, joint_positions=None)
        )

    return FrameRecording([changed(frame) for frame in episode.frames], geometry=episode.geometry)


@cache
def found(*, noise_seed: int | None = None, contacts: bool = True) -> tuple[EpisodeEvent, ...]:
    return detect_events(recording(noise_seed=noise_seed, contacts=contacts))


def changes(events: Sequence[EpisodeEvent]) -> list[EpisodeEvent]:
    """The events without the relations that hold from the begin to the end of the recording."""
    return [event for event in events if event.begin_s > 0.0 or event.end_s is not None]


def matches(expected: Expected, event: EpisodeEvent, last_s: float) -> bool:
    """Whether an event is the expected one, with a begin and an end within 0.1 s."""
    participants = (event.thing, event.other)
    same = (expected.thing, expected.other) in (
        (participants, participants[::-1]) if event.kind in SYMMETRIC else (participants, (event.thing, None))
    )
    begins, ends = (abs(a - b) <= MAX_ERROR_S for a, b in (
        (event.begin_s, expected.begin_s),
        (last_s if event.end_s is None else event.end_s, last_s if expected.end_s is None else expected.end_s),
    ))  # fmt: skip
    return event.kind == expected.kind and same and begins and ends and event.joint == expected.joint


def score(events: Sequence[EpisodeEvent]) -> tuple[float, float, str]:
    """Precision, recall, and what is missing or wrong."""
    last_s, expected, left = kitchen_episode().frames[-1].time_s, kitchen_episode().expected, changes(events)
    missing = []
    for each in expected:
        match = next((event for event in left if matches(each, event, last_s)), None)
        if match is None:
            missing.append(each)
        else:
            left.remove(match)
    right = len(expected) - len(missing)
    return right / max(right + len(left), 1), right / len(expected), f"missing: {missing}\nwrong: {left}"


@pytest.mark.parametrize(
    ("noise_seed", "contacts"),
    [
        pytest.param(None, True, id="with contacts"),
        pytest.param(1, True, id="with contacts and noise", marks=pytest.mark.slow),
        pytest.param(None, False, id="from poses alone", marks=pytest.mark.slow),
        pytest.param(1, False, id="from poses alone with noise"),
    ],
)
def test_the_scripted_kitchen_is_detected_with_times_within_a_tenth_of_a_second(
    noise_seed: int | None, contacts: bool
) -> None:
    precision, recall, text = score(found(noise_seed=noise_seed, contacts=contacts))
    assert precision >= 0.95, text
    assert recall >= 0.95, text


def test_every_kind_of_event_happens_in_the_script() -> None:
    # A collision between hands or fingers that grip from both sides is tested with made-up frames.
    detected = set(EpisodeEventKind) - {EpisodeEventKind.PERFORM}  # it is reported, not detected
    assert {each.kind for each in kitchen_episode().expected} == detected


def test_a_wrong_list_scores_badly() -> None:
    # The comparison itself: events that are shifted by 0.2 s, or have other participants, do not count.
    late = [replace(event, begin_s=event.begin_s + 0.2) for event in found()]
    assert score(late)[1] < 0.2
    swapped = [replace(event, thing=event.other or event.thing, other=event.thing) for event in found()]
    assert score(swapped)[1] < 0.5


@pytest.mark.parametrize("noise_seed", [None, 1])
@pytest.mark.parametrize("contacts", [True, False], ids=["with contacts", "from poses alone"])
def test_no_event_is_reported_twice(noise_seed: int | None, contacts: bool) -> None:
    by_participants = defaultdict(list)
    events = found(noise_seed=noise_seed, contacts=contacts)
    assert len({event.id for event in events}) == len(events)
    for event in events:
        pair = frozenset((event.thing, event.other)) if event.kind in SYMMETRIC else (event.thing, event.other)
        by_participants[event.kind, pair, event.joint].append(event)
    for same in by_participants.values():
        for before, after in pairwise(same):
            assert before.end_s is not None, (before, after)
            assert after.begin_s >= before.end_s, (before, after)


@pytest.mark.parametrize("noise_seed", [None, 1])
def test_intervals_are_within_the_recording_and_not_shorter_than_a_tenth_of_a_second(noise_seed: int | None) -> None:
    last_s = kitchen_episode().frames[-1].time_s
    for event in found(noise_seed=noise_seed):
        assert 0.0 <= event.begin_s <= last_s
        if event.end_s is not None:
            assert event.end_s <= last_s
            if event.kind is not EpisodeEventKind.COLLISION:
                assert event.end_s - event.begin_s >= 0.1 - 1e-6, event


def test_each_event_states_what_it_was_concluded_from() -> None:
    for event in found():
        if event.end_s is not None or event.kind in {EpisodeEventKind.CONTACT, EpisodeEventKind.GRASP}:
            assert event.evidence, event
            assert all(sentence.endswith(".") for sentence in event.evidence)


def test_events_that_are_found_while_it_runs_are_those_of_the_recording() -> None:
    frames = kitchen_episode().frames
    whole, half = (EventDetector(geometry=kitchen_episode().geometry) for _ in range(2))
    reported = [whole.update(frame) for frame in frames]
    assert [half.update(frame) for frame in frames[:600]] == reported[:600]
    ended = whole.finish()
    last: dict[str, EpisodeEvent] = {}
    for event in [event for each in (*reported, ended) for event in each]:
        before = last.get(event.id)
        if before is not None:  # the second report is the end of the first one
            assert before.end_s is None
            assert event.end_s is not None
            assert (before.kind, before.begin_s, before.thing) == (event.kind, event.begin_s, event.thing)
        assert event.state is EventState.PROVISIONAL
        last[event.id] = replace(event, state=EventState.FINAL)
    assert tuple(sorted(last.values(), key=lambda event: event.id)) == tuple(
        sorted(found(), key=lambda event: event.id)
    )


def test_an_event_is_reported_soon_after_it_has_begun() -> None:
    detector = EventDetector(geometry=kitchen_episode().geometry)
    for frame in kitchen_episode().frames:
        for event in detector.update(frame):
            moment = event.begin_s if event.end_s is None else event.end_s
            assert frame.time_s - moment <= 0.5, event


def test_containment_holds_exactly_while_the_spatial_relation_does() -> None:
    events = [event for event in found() if event.kind is EpisodeEventKind.CONTAINMENT]
    for frame in kitchen_episode().frames[::150]:
        world = frame.world()
        fixed = {body.id for body in world.bodies if not (body.physics.is_dynamic or body.id == "gripper")}
        groups = {each.child: each.parent for each in world.attachments}
        related = {
            (pair.body.id, pair.other.id)
            for pair in SpatialRelations(world).related(relations=[SpatialRelation.INSIDE])
            if pair.body.id not in fixed and groups.get(pair.body.id) != pair.other.id
        }
        holding = {
            (event.thing, event.other)
            for event in events
            if event.begin_s <= frame.time_s and (event.end_s is None or frame.time_s < event.end_s)
        }
        assert {pair for pair in holding if pair[0] not in fixed} == related, frame.time_s


def test_grasps_of_a_body_that_swings_on_a_force_do_not_overlap() -> None:
    with Simulation(KnowledgeBase(), MujocoEngine()) as simulation:
        simulation.spawn(kitchenette())
        frames: list[EpisodeFrame] = []
        for number in range(120):
            up = number // 20 % 2
            simulation.pull(MUG, point=(0.0, 0.0, 0.0), target=(1.0, 0.0, 1.2 + 0.8 * up))
            frames.append(frame_of(simulation, number / 30, frames[-1] if frames else None))
            simulation.step(1 / 30)
        swinging = FrameRecording(frames, geometry=simulation.geometry, spawned=(kitchenette(),))
    grasps = [each for each in detect_events(swinging) if each.kind is EpisodeEventKind.GRASP and each.thing == MUG]
    assert len(grasps) > 1  # it falls freely when the target moves down
    for first, second in pairwise(grasps):
        assert first.end_s is not None
        assert first.end_s <= second.begin_s + 1e-9


def test_ids_and_order_are_the_same_in_each_process() -> None:
    program = (
        "import mindstage as ms\n"
        "from mindstage.episodes import FrameRecording, detect_events\n"
        "from tests.episodes.kitchenette_recording import frame_of\n"
        "with ms.open('bundled:kitchen') as simulation:\n"
        "    first = frame_of(simulation, 0.0)\n"
        "    frames = [first, *(frame_of(simulation, time_s, first) for time_s in (0.1, 0.2, 0.3))]\n"
        "print([event.id + event.thing for event in detect_events(FrameRecording(frames))])"
    )
    printed = {
        subprocess.run(
            [sys.executable, "-c", program],
            env={**os.environ, "PYTHONHASHSEED": seed, "PYTHONPATH": os.pathsep.join(sys.path)},
            capture_output=True,
            check=True,
            timeout=120.0,
        ).stdout
        for seed in ("1", "2")
    }
    assert len(printed) == 1
    assert b"ContainedIn_9" in printed.pop()
